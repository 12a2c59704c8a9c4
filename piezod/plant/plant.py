"""One axis of the simulated rig: a stage with its amplifier and its sensor."""

from typing import Final

import numpy as np

from piezod.errors import DeviceError
from piezod.plant.kernel import advance, fibre_v
from piezod.plant.layout import DRAWN, PAST, at_rest, constants
from piezod.plant.parameters import PlantParameters
from piezod.units import NS_PER_S

SUB_STEP_NS: Final = 50_000


class Plant:
    """A stage that is driven and watched, in time that the caller tells.

    It starts at rest at time 0: 0 V since long, conditioned, so that its memory is known. Inside,
    time goes in sub-steps. A command acts from the first sub-step that begins at or after the
    instant it is given; the instants of samples are not rounded.

    Args:
        parameters: What the plant is made of, used as they are.
        seed: Of the noise. With the same seed and the same calls a plant does the same to the bit,
            and how the calls divide the time makes no difference to the noise.
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
        if delay > PAST - 3:
            raise ValueError(f"a delay of {delay:.0f} sub-steps is longer than what is kept")
        self.parameters = parameters
        self._rng = np.random.default_rng(seed)
        self._sub_step_ns = sub_step_ns
        self._delay = delay
        self._constants = constants(parameters, sub_step_ns / NS_PER_S)
        self._state = at_rest(self._constants)
        self._noise = self._state["noise"][0]
        self._left = 0
        self._command_v = 0.0
        self.now_ns = 0
        self._grid_ns = 0
        self._reading_v = advance(0, 0.0, delay, self._state, self._constants)

    def advance_to(self, t_ns: int) -> None:
        """Let time pass until `t_ns`. May be called in the loop.

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
        sub_steps = -((self._grid_ns - t_ns) // self._sub_step_ns)
        self._grid_ns += sub_steps * self._sub_step_ns
        while sub_steps > self._left:
            self._run(self._left, 0.0)
            sub_steps -= self._left
            self._rng.standard_normal(out=self._noise)
            self._state["taken"] = 0
            self._left = DRAWN
        ago = self._delay + (self._grid_ns - t_ns) / self._sub_step_ns
        self._reading_v = self._run(sub_steps, ago)
        self._left -= sub_steps

    def _run(self, sub_steps: int, ago: float) -> float:
        return advance(sub_steps, self._command_v, ago, self._state, self._constants)

    def command(self, drive_v: float) -> None:
        """Command a voltage from now on. May be called in the loop.

        Args:
            drive_v: Voltage across the actuator in V, finite; limits are the amplifier's matter.
        """
        self._command_v = drive_v

    def sample(self) -> float:
        """Give what the sensor's converter reports now, in V. May be called in the loop."""
        return self._reading_v

    @property
    def drive_v(self) -> float:
        """Voltage across the actuator now, in V, with the amplifier's noise."""
        return float(self._state["drive_v"][0])

    @property
    def true_displacement_um(self) -> float:
        """What the mechanics does now, in µm from rest, before sensor, filter and delay."""
        return float(self._state["displacement_um"][0])

    @property
    def dropped_turns(self) -> int:
        """How many pairs of turning points the memory had no room for."""
        return int(self._state["dropped"][0])

    def ideal_reading_v(self, position_um: float) -> float:
        """Give the sensor's voltage at a displacement held still, without noise and converter.

        Args:
            position_um: Displacement from rest in µm.
        """
        return fibre_v(position_um, self._constants)
