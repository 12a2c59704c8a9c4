"""One axis of the simulated rig: a stage with its amplifier and its sensor."""

from typing import Final

import numpy as np

from piezod.errors import DeviceError
from piezod.plant.kernel import advance, fibre_v
from piezod.plant.laws import Array
from piezod.plant.layout import DELAY_BUFFER, NOISE_BLOCK, at_rest, constants
from piezod.plant.parameters import PlantParameters
from piezod.plant.point_by_point import play
from piezod.units import NS_PER_S

SUB_STEP_NS: Final = 50_000


class Plant:
    """A simulated axis that is driven and sampled, in the caller's time.

    It starts at rest at time 0, at 0 V since long, with a known hysteresis memory. Inside, time
    advances in sub-steps. A command acts from the first sub-step that begins at or after its
    instant; the instants of samples are not rounded.

    Args:
        parameters: Parameters of the plant, used without variation.
        seed: Seed of the noise. Equal seeds and calls give equal results to the bit. The division
            of time into calls does not change the noise.
        sub_step_ns: Sub-step in ns, at least 10 µs.

    Attributes:
        parameters: As given.
        now_ns: Time since the plant began, in ns.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        seed: np.random.SeedSequence,
        sub_step_ns: int = SUB_STEP_NS,
    ) -> None:
        delay = parameters.sensor.delay_s * NS_PER_S / sub_step_ns
        if delay > DELAY_BUFFER - 3:  # the interpolation needs the neighbours
            raise ValueError(
                f"a delay of {delay:.0f} sub-steps exceeds the {DELAY_BUFFER - 3} stored"
            )
        self.parameters = parameters
        self._rng = np.random.default_rng(seed)
        self._sub_step_ns = sub_step_ns
        self._delay = delay
        self._constants = constants(parameters, sub_step_ns / NS_PER_S)
        self._state = at_rest(self._constants)
        self._noise, self._drive_v = self._state["noise"][0], self._state["drive_v"]
        self._left = 0  # sub-steps for which noise is still available
        self.command_v = 0.0
        """Commanded voltage across the actuator, in V."""
        self.now_ns = 0
        self._grid_ns = 0
        self._reading_v = advance(0, 0.0, delay, self._state, self._constants)

    def advance_to(self, t_ns: int) -> None:
        """Advance the plant to `t_ns`. Real-time safe.

        Args:
            t_ns: Time since the plant began, in ns.

        Raises:
            DeviceError: If that is in the past.
        """
        if t_ns < self.now_ns:
            raise DeviceError(f"time went back from {self.now_ns} ns to {t_ns} ns")
        if t_ns == self.now_ns:
            return
        self.now_ns = t_ns
        # Sub-steps up to the first grid instant at or after t_ns; the reading is interpolated back.
        sub_steps = -((self._grid_ns - t_ns) // self._sub_step_ns)
        self._grid_ns += sub_steps * self._sub_step_ns
        while sub_steps > self._left:  # the block of noise ends before t_ns: use it up first
            advance(self._left, self.command_v, 0.0, self._state, self._constants)
            sub_steps -= self._left
            self._rng.standard_normal(out=self._noise)
            self._state["noise_used"] = 0
            self._left = NOISE_BLOCK
        # The reading is older than the grid by the delay plus the part of the sub-step after t_ns.
        ago = self._delay + (self._grid_ns - t_ns) / self._sub_step_ns
        self._reading_v = advance(sub_steps, self.command_v, ago, self._state, self._constants)
        self._left -= sub_steps

    def play(self, commands_v: Array, sub_steps: int, readings_v: Array, truths_um: Array) -> None:
        """Advance from point to point: the same as `advance_to`, reading and `command` at each.

        It takes a tenth of the time. The plant must be on the grid of its sub-steps.

        Args:
            commands_v: (n,) command from each point on, in V.
            sub_steps: Sub-steps before each point.
            readings_v: (n,) reading of the sensor at each point, in V; filled.
            truths_um: (n,) displacement at each point, in µm; filled.
        """
        k = 0
        while k < commands_v.size:
            # As many points as the block of noise suffices for.
            last = min(k + self._left // sub_steps, commands_v.size)
            if last == k:  # the block ends before the next point
                self.advance_to(self.now_ns + sub_steps * self._sub_step_ns)
                readings_v[k], truths_um[k] = self._reading_v, self.true_displacement_um
                last = k + 1
            else:
                self._play(k, last, sub_steps, commands_v, readings_v, truths_um)
            self.command_v, k = float(commands_v[last - 1]), last

    def _play(
        self, k: int, last: int, steps: int, commands_v: Array, readings_v: Array, truths_um: Array
    ) -> None:
        play(
            k,
            last,
            steps,
            self.command_v,
            commands_v,
            self._delay,
            readings_v,
            truths_um,
            self._state,
            self._constants,
        )
        passed = (last - k) * steps
        self._left -= passed
        self.now_ns += passed * self._sub_step_ns
        self._grid_ns = self.now_ns
        self._reading_v = float(readings_v[last - 1])

    def command(self, drive_v: float) -> None:
        """Command a voltage from now on. Real-time safe.

        Args:
            drive_v: Voltage across the actuator in V, finite; the amplifier applies its limits.
        """
        self.command_v = drive_v

    def sample(self) -> float:
        """Return the present reading of the sensor's converter, in V. Real-time safe."""
        return self._reading_v

    @property
    def drive_v(self) -> float:
        """Present voltage across the actuator, in V, with the amplifier's noise."""
        return float(self._drive_v[0])

    @property
    def true_displacement_um(self) -> float:
        """Present displacement of the mechanics from rest, in µm, before sensor and delay."""
        return float(self._state["displacement_um"][0])

    @property
    def dropped_turns(self) -> int:
        """Number of pairs of turning points that a full memory has dropped."""
        return int(self._state["dropped"][0])

    def ideal_reading_v(self, position_um: float) -> float:
        """Return the sensor's voltage at a constant displacement, without noise and quantisation.

        Args:
            position_um: Displacement from rest in µm.
        """
        return fibre_v(position_um, self._constants)
