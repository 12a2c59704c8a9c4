"""The simulated rig as a device: sensor and amplifier of one or several axes in one."""

from collections.abc import Sequence
from math import isfinite
from typing import Final, NamedTuple

import numpy as np

import piezod
from piezod.devices.calibration import TableCurve
from piezod.devices.interface import Capabilities, DriverPlugin, Identity, Sample, Wiring
from piezod.errors import DeviceError
from piezod.plant.plant import SUB_STEP_NS, Plant
from piezod.units import NS_PER_S
from piezod_drivers.simulated.calibration import commissioned, straight_line
from piezod_drivers.simulated.options import Commissioned, SensorLine, SensorTable, SimulatedOptions

_REST_V: Final = 0.0
_SENSOR_V, _LIGHT = "_v", "_light"


class _Channel(NamedTuple):
    """One axis.

    Attributes:
        plant: Its physics.
        calibration: Of its sensor.
        lowest_v: Lowest voltage the amplifier can give, in V.
        highest_v: Highest voltage the amplifier can give, in V.
        saturated_v: Magnitude from which on the sensor's voltage is not to be trusted.
    """

    plant: Plant
    calibration: TableCurve
    lowest_v: float
    highest_v: float
    saturated_v: float

    def sample(self, t_ns: int, now_ns: int, what: str) -> Sample:
        """Take a sample at `t_ns` in the plant's time, `now_ns` in the caller's."""
        self.plant.advance_to(t_ns)
        if what == _LIGHT:
            return Sample(now_ns, self.plant.parameters.sensor.light_level, True)
        sensor_v = self.plant.sample()
        valid = abs(sensor_v) < self.saturated_v
        return Sample(now_ns, sensor_v if what else self.calibration.beyond(sensor_v), valid)

    def takes(self, drive_v: float) -> bool:
        """Tell whether the amplifier can give this voltage."""
        return isfinite(drive_v) and self.lowest_v <= drive_v <= self.highest_v


class SimulatedRig:
    """A rig that exists only in numbers; implements `Sensor`, `Amplifier` and `KnowsTruth`.

    Each `open` sets it up anew: every stage at rest at 0 V, its memory known. Its time begins with
    the first call that carries an instant. A voltage is in force when the amplifier's output has
    reached it, so `read_back` lags a write as the output does. To deactivate sets the command to
    0 V; the output falls as fast as the amplifier's bandwidth, slew rate and current limit let it
    (150 V take about 5 ms), and it keeps falling while nobody calls.

    Every output is a stage of its own. An input of the same name measures it in µm; with `_v`
    behind the name it is the sensor's voltage, not calibrated, and with `_light` the sensor's
    light, 1 at nominal.

    Args:
        options: What a configuration says.
        wiring: Names of the channels, at least one.
        seed: Of the specimens, the noise and the calibration's residual; not negative.
    """

    def __init__(self, options: SimulatedOptions, wiring: Wiring, seed: int) -> None:
        self._options = options
        self._wiring = wiring
        self._seed = seed
        inputs = [_split(name, wiring.outputs) for name in wiring.inputs]
        self._axes = tuple(dict.fromkeys((*wiring.outputs, *(axis for axis, _ in inputs))))
        self._inputs = [(self._axes.index(axis), what) for axis, what in inputs]
        self._channels: list[_Channel] = []
        self._origin_ns: int | None = None
        self._active = False

    def open(self) -> Identity:
        """Set the rig up; compiles or loads the physics, which takes up to a few seconds.

        Raises:
            DeviceError: If it is already open, or a sensor cannot be calibrated.
        """
        if self._channels:
            raise DeviceError("the simulated rig is already open")
        seeds = np.random.SeedSequence(self._seed).spawn(len(self._axes))
        self._channels = [_channel(self._options, seed) for seed in seeds]
        self._origin_ns = None
        return Identity(
            maker="piezod",
            model=f"simulated {self._options.variant}",
            serial=f"seed {self._seed}",
            firmware=piezod.__version__,
        )

    def capabilities(self) -> Capabilities:
        """Tell axes and fastest loop.

        Raises:
            DeviceError: If the rig is not open.
        """
        self._require_open()
        return Capabilities(
            *self._wiring, read_back=True, max_rate_hz=NS_PER_S / SUB_STEP_NS, opens_relaxed=True
        )

    def activate(self, now_ns: int) -> None:
        """Take writes from now on.

        Raises:
            DeviceError: If the rig is not open.
        """
        self._require_open()
        self._elapsed_ns(now_ns)
        self._active = True

    def deactivate(self, now_ns: int) -> None:
        """Command 0 V and refuse writes from now on."""
        if self._active:
            t_ns = self._elapsed_ns(now_ns)
            for channel in self._channels:
                channel.plant.advance_to(max(t_ns, channel.plant.now_ns))
        self._rest()

    def close(self) -> None:
        """Command 0 V and let go of the rig."""
        self._rest()
        self._channels = []

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample of each axis now; invalid where the sensor is saturated.

        May be called in the loop.

        Raises:
            DeviceError: If the rig is not active, or time went back.
        """
        self._require_active()
        t_ns = self._elapsed_ns(now_ns)
        return [self._channels[i].sample(t_ns, now_ns, what) for i, what in self._inputs]

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Tell the displacement of each stage now, in µm from rest at 0 V, before its sensor.

        It is that at the end of the physics' sub-step, at most 50 µs from now. May be called in the
        loop, after the `read` of the same instant.

        Raises:
            DeviceError: If the rig is not active, or time went back.
        """
        self._require_active()
        t_ns = self._elapsed_ns(now_ns)
        for channel in self._channels:
            channel.plant.advance_to(t_ns)
        return [self._channels[i].plant.true_displacement_um for i, _ in self._inputs]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Command a voltage for each axis, in V; all are taken or none.

        May be called in the loop.

        Returns:
            Whether they were taken: the rig is active, there is one value for each axis, and each
            is finite and within what the amplifier can give.

        Raises:
            DeviceError: If time went back.
        """
        driven = self._driven
        if not self._active or len(drive_v) != len(driven):
            return False
        if not all(map(_Channel.takes, driven, drive_v)):
            return False
        t_ns = self._elapsed_ns(now_ns)
        for channel, command_v in zip(driven, drive_v, strict=True):
            channel.plant.advance_to(t_ns)
            channel.plant.command(float(command_v))
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Measure the output of each amplifier now, in V. May be called in the loop.

        Raises:
            DeviceError: If the rig is not open, or time went back.
        """
        self._require_open()
        t_ns = self._elapsed_ns(now_ns)
        for channel in self._driven:
            channel.plant.advance_to(t_ns)
        return [channel.plant.drive_v for channel in self._driven]

    @property
    def _driven(self) -> "list[_Channel]":
        return self._channels[: len(self._wiring.outputs)]

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

    def _rest(self) -> None:
        self._active = False
        for channel in self._channels:
            channel.plant.command(_REST_V)


def _split(name: str, outputs: Sequence[str]) -> tuple[str, str]:
    """Return the axis that an input measures, and what of it: nothing said is the displacement."""
    for what in (_SENSOR_V, _LIGHT):
        if name not in outputs and name.endswith(what):
            return name.removesuffix(what), what
    return name, ""


def _channel(options: SimulatedOptions, seed: np.random.SeedSequence) -> _Channel:
    of_specimen, of_noise, of_calibration = seed.spawn(3)
    parameters = options.plant(of_specimen)
    plant = Plant(parameters, of_noise)
    amplifier, sensor = parameters.amplifier, parameters.sensor
    converter_v = amplifier.dac_range_v * amplifier.gain
    return _Channel(
        plant,
        _calibration(options.known_curve(), plant, of_calibration),
        max(amplifier.output_min_v, -converter_v),
        min(amplifier.output_max_v, converter_v),
        sensor.saturation_v,
    )


def _calibration(
    known: Commissioned | SensorLine | SensorTable, plant: Plant, seed: np.random.SeedSequence
) -> TableCurve:
    travel_um = plant.parameters.stage.travel_um
    match known:
        case Commissioned():
            return commissioned(plant.ideal_reading_v, travel_um, known.residual_pct, seed)
        case SensorLine():
            return straight_line(plant.ideal_reading_v, travel_um)
        case SensorTable():
            return TableCurve(zip(known.sensor_v, known.position_um, strict=True))


PLUGIN: Final = DriverPlugin(
    name="simulated",
    summary="a stage with amplifier and sensor that exists only in numbers",
    options_model=SimulatedOptions,
    create=SimulatedRig,
    confirmed_on_hardware=False,
)
