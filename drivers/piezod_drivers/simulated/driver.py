"""The driver `simulated`: sensor and amplifier of one or several simulated axes in one."""

from collections.abc import Sequence
from typing import Final

import numpy as np

import piezod
from piezod.devices.interface import Capabilities, DriverPlugin, Identity, Sample, Wiring
from piezod.devices.player import (
    Check,
    PlayedRecord,
    PlayerCapabilities,
    Progress,
    Table,
    go_on,
)
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.simulated.axis import (
    LIGHT,
    PHOTONS,
    FloatArray,
    SimulatedAxis,
    axis_and_quantity,
    make_axis,
)
from piezod_drivers.simulated.coupling import RigCoupling
from piezod_drivers.simulated.lines import RigLines, axes_of
from piezod_drivers.simulated.options import SimulatedOptions
from piezod_drivers.simulated.pattern import counts_at
from piezod_drivers.simulated.player import TablePlayer

_REST_V: Final = 0.0


class SimulatedRig:
    """A simulated rig: `Sensor`, `Amplifier` and `Player` in one, and it knows the truth of both.

    Each `open` sets it up again: every stage is at rest at 0 V, with known hysteresis memory. Its
    time starts with the first call that has an instant. A voltage is in force when the amplifier's
    output has reached it, so `read_back` lags a write as the output does. `deactivate` sets the
    command to 0 V. The output falls as fast as the amplifier's bandwidth, slew rate and current
    limit allow (150 V take about 5 ms), and it continues to fall without calls.

    Every output is a stage of its own. An input of the same name measures it in µm. With `_v`
    behind the name the input is the uncalibrated voltage of the sensor, with `_light` its light, 1
    at nominal. An input `photons` has the counts of a detector over a test pattern. Channels with
    `line:` before the name are digital lines, which come last in the wiring.

    Args:
        wiring: Names of the channels, at least one.
        seed: Seed of the specimens, the noise and the calibration's residual; not negative.
    """

    def __init__(self, options: SimulatedOptions, wiring: Wiring, seed: int) -> None:
        self._options = options
        self._channel_names, wiring = wiring, axes_of(wiring)
        self._wiring = wiring
        self._seed = seed
        self._lines = RigLines(Wiring((), ()), None)
        inputs = [axis_and_quantity(name, wiring.outputs) for name in wiring.inputs]
        # Driven axes first, each once: `_driven` relies on this order. An input without an
        # output is a stage that nothing drives.
        self._axes = tuple(dict.fromkeys((*wiring.outputs, *(axis for axis, _ in inputs))))
        self._inputs = [(self._axes.index(axis), quantity) for axis, quantity in inputs]
        self._channels: list[SimulatedAxis] = []
        self._driven: list[SimulatedAxis] = []
        self._player, self._playing = TablePlayer([], 0, [], options), False
        self._coupling: RigCoupling | None = None
        self._origin_ns: int | None = None
        self._active = False

    def open(self) -> Identity:
        """Set up the rig. Compiling or loading the physics takes up to a few seconds.

        Raises:
            DeviceError: If it is already open, or a sensor cannot be calibrated.
        """
        if self._channels:
            raise DeviceError("the simulated rig is already open")
        self._lines = RigLines(self._channel_names, self._options.camera)
        # A seed of its own for each axis: another axis does not change the specimens of the first
        # ones.
        seeds = np.random.SeedSequence(self._seed).spawn(len(self._axes))
        self._channels = [make_axis(self._options, seed) for seed in seeds]
        self._driven = self._channels[: len(self._wiring.outputs)]
        outputs = len(self._wiring.outputs)
        self._player = TablePlayer(self._channels, outputs, self._inputs, self._options)
        if self._options.coupling:
            lag_ns = self._options.coupling_lag_s * NS_PER_S
            self._coupling = RigCoupling(self._options.coupling, self._axes, self._inputs, lag_ns)
        self._origin_ns = None
        return Identity(
            maker="piezod",
            model=f"simulated {self._options.variant}",
            serial=f"seed {self._seed}",
            firmware=piezod.__version__,
        )

    def capabilities(self) -> Capabilities:
        """Return axes and highest rate."""
        self._require_open()
        max_rate_hz = NS_PER_S / self._options.sub_step_ns
        return Capabilities(
            *self._channel_names, read_back=True, max_rate_hz=max_rate_hz, opens_relaxed=True
        )

    def activate(self, now_ns: int) -> None:
        """Accept writes from now on."""
        self._require_open()
        self._elapsed_ns(now_ns)
        self._active = True

    def deactivate(self, now_ns: int) -> None:
        """Command 0 V and refuse writes from now on."""
        if self._active:
            t_ns = self._played_to(now_ns)
            for axis_model in self._channels:
                # Time must not go back, also if the caller's instant is older than the last call.
                axis_model.plant.advance_to(max(t_ns, axis_model.plant.now_ns))
        self._rest()

    def close(self) -> None:
        """Command 0 V and drop the rig."""
        self._rest()
        self._channels, self._driven = [], []

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample of each input; invalid if the sensor is saturated. Real-time safe.

        Raises:
            DeviceError: If the rig is not active, or time went back.
        """
        self._require_active()
        t_ns = self._played_to(now_ns)
        for axis_model in self._channels:
            axis_model.plant.advance_to(t_ns)
        own = [
            self._counted(now_ns)
            if quantity == PHOTONS
            else _sample(self._channels[i], quantity, now_ns)
            for i, quantity in self._inputs
        ]
        if self._coupling is not None:
            self._coupling.advance(
                [each.plant.true_displacement_um for each in self._channels], t_ns
            )
            uncoupled = [_sample(each, "", now_ns) for each in self._channels]
            own = self._coupling.samples(own, uncoupled)
        return [*own, *self._lines.samples(t_ns, now_ns)] if self._lines.inputs else own

    def _counted(self, now_ns: int) -> Sample:
        true_um = [[axis_model.plant.true_displacement_um for axis_model in self._driven]]
        return Sample(now_ns, float(counts_at(np.array(true_um))[0]), True)

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return the true displacement of each stage from rest at 0 V, in µm. Real-time safe.

        It is the displacement before the sensor, at the end of the physics' sub-step, less than one
        sub-step from now. Call it after the `read` of the same instant.

        Raises:
            DeviceError: If the rig is not active, or time went back.
        """
        self._require_active()
        t_ns = self._played_to(now_ns)
        for axis_model in self._channels:
            axis_model.plant.advance_to(t_ns)
        true_um = [each.plant.true_displacement_um for each in self._channels]
        if self._coupling is not None:
            true_um = self._coupling.advance(true_um, t_ns)
        return [true_um[i] for i, _ in self._inputs]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Command a voltage for each axis, in V; all are accepted or none. Real-time safe.

        Returns:
            Whether they were accepted: the rig is active and plays no table, there is one value for
            each axis, and each is finite and within the amplifier's limits.

        Raises:
            DeviceError: If time went back.
        """
        driven, lines = self._driven, self._lines.outputs
        if not self._active or len(drive_v) != len(driven) + len(lines):
            return False
        # All voltages are checked before one is commanded; NaN compares false.
        for i, axis_model in enumerate(driven):
            if not axis_model.lowest_v <= drive_v[i] <= axis_model.highest_v:
                return False
        t_ns = self._played_to(now_ns)
        if self._playing:
            return False
        for i, axis_model in enumerate(driven):
            plant = axis_model.plant
            if plant.now_ns != t_ns:
                plant.advance_to(t_ns)
            plant.command_v = float(drive_v[i])
        if lines:
            self._lines.set(drive_v[len(driven) :])
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Measure the output of each amplifier, in V. Real-time safe.

        Raises:
            DeviceError: If the rig is not open, or time went back.
        """
        self._require_open()
        t_ns = self._played_to(now_ns)
        driven = self._driven
        for axis_model in driven:
            if axis_model.plant.now_ns != t_ns:
                axis_model.plant.advance_to(t_ns)
        return [*(axis_model.plant.drive_v for axis_model in driven), *self._lines.values]

    def player_capabilities(self) -> PlayerCapabilities:
        """Return the capabilities: points are on the grid of the physics.

        Raises:
            DeviceError: If its axes are coupled: a record would show each axis by itself; or if
                lines of it are in use.
        """
        self._require_open()
        if self._coupling is not None:
            raise DeviceError("the rig plays no tables while its axes are coupled")
        if self._lines.inputs or self._lines.outputs:
            raise DeviceError("the rig plays no tables while the loop has its lines")
        return self._player.capabilities

    def load(self, table: Table, check: Check = go_on) -> Table:
        """Load a table; return it as the converters will output it."""
        self._require_active()
        check()
        return self._player.load(table)

    def arm(self) -> None:
        """Prepare the start."""
        self._require_active()
        self._player.arm()

    def start(self, now_ns: int) -> None:
        """Start the play and the record, at the first sub-step at or after now."""
        self._require_active()
        self._player.start(self._played_to(now_ns))
        self._playing = True

    def replace(self, period: FloatArray) -> FloatArray:
        """Replace the period from the next cycle on; return it as the converters will output it."""
        self._require_active()
        return self._player.replace(period)

    def progress(self, now_ns: int) -> Progress:
        """Play up to now and return the progress. Real-time safe."""
        self._require_active()
        self._played_to(now_ns)
        return self._player.progress()

    def abort(self, now_ns: int) -> tuple[float, ...]:
        """Stop the play; return the commanded voltage of each output. Real-time safe."""
        if self._active:
            self._played_to(now_ns)
        self._player.abort()
        self._playing = False
        return tuple(axis_model.plant.command_v for axis_model in self._driven)

    def recording(self, check: Check = go_on) -> PlayedRecord:
        """Return the record of the play that has ended."""
        self._require_active()
        check()
        return self._player.recording()

    def true_recording(self) -> FloatArray:
        """Return the true displacements at the samples of `recording`, in µm, shape (k, inputs)."""
        self._require_active()
        return self._player.true_recording()

    def pulses_counted(self) -> tuple[int, ...]:
        """Return the number of pulses of each line since the rig was opened."""
        of_loop = self._lines.pulses.values() if self._lines.outputs else ()
        return tuple(of_loop or self._player.pulses.tolist())

    def _require_open(self) -> None:
        if not self._channels:
            raise DeviceError("the simulated rig is not open")

    def _require_active(self) -> None:
        if not self._active:
            raise DeviceError("the simulated rig is not active")

    def _elapsed_ns(self, now_ns: int) -> int:
        if self._origin_ns is None:
            self._origin_ns = now_ns
        return now_ns - self._origin_ns

    def _played_to(self, now_ns: int) -> int:
        """Play up to now; return now in the rig's time, in ns."""
        t_ns = self._elapsed_ns(now_ns) if self._origin_ns is None else now_ns - self._origin_ns
        if self._playing:
            self._player.play_to(t_ns)
            self._playing = self._player.plays
        return t_ns

    def _rest(self) -> None:
        self._active = self._playing = False
        self._player.abort()
        for axis_model in self._channels:
            axis_model.plant.command_v = _REST_V


def _sample(axis_model: SimulatedAxis, quantity: str, now_ns: int) -> Sample:
    """Take a sample at the present instant of the plant, `now_ns` in the caller's time."""
    if quantity == LIGHT:
        return Sample(now_ns, axis_model.plant.parameters.sensor.light_level, True)
    sensor_v = axis_model.plant.sample()
    valid = abs(sensor_v) < axis_model.saturated_v
    # `beyond` also extrapolates the calibration: the stage may move beyond the calibrated range.
    value = sensor_v if quantity else axis_model.calibration.beyond(sensor_v)
    return Sample(now_ns, value, valid)


PLUGIN: Final = DriverPlugin(
    name="simulated",
    summary="a simulated stage with amplifier and sensor",
    options_model=SimulatedOptions,
    create=SimulatedRig,
    confirmed_on_hardware=False,
)
