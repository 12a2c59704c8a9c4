"""The driver `simulated`: sensor and amplifier of one or several simulated axes in one."""

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
from piezod_drivers.simulated.calibration import commissioned_curve, straight_line_curve
from piezod_drivers.simulated.options import Commissioned, SensorLine, SensorTable, SimulatedOptions

_REST_V: Final = 0.0
_SENSOR_V, _LIGHT = "_v", "_light"


class _SimulatedAxis(NamedTuple):
    """One axis.

    Attributes:
        plant: Its physics.
        calibration: Calibration of its sensor.
        lowest_v: Lowest voltage of the amplifier, in V.
        highest_v: Highest voltage of the amplifier, in V.
        saturated_v: Magnitude of the sensor's voltage from which on it is saturated, in V.
    """

    plant: Plant
    calibration: TableCurve
    lowest_v: float
    highest_v: float
    saturated_v: float

    def sample(self, t_ns: int, now_ns: int, quantity: str) -> Sample:
        """Take a sample at `t_ns` in the plant's time, `now_ns` in the caller's."""
        self.plant.advance_to(t_ns)
        if quantity == _LIGHT:
            return Sample(now_ns, self.plant.parameters.sensor.light_level, True)
        sensor_v = self.plant.sample()
        valid = abs(sensor_v) < self.saturated_v
        # `beyond` also extrapolates the calibration, because the stage may move beyond the
        # calibrated range.
        return Sample(now_ns, sensor_v if quantity else self.calibration.beyond(sensor_v), valid)

    def takes(self, drive_v: float) -> bool:
        """Return whether the amplifier can output this voltage."""
        return isfinite(drive_v) and self.lowest_v <= drive_v <= self.highest_v


class SimulatedRig:
    """A simulated rig; implements `Sensor`, `Amplifier` and `KnowsTruth`.

    Each `open` sets it up again: every stage is at rest at 0 V, with known hysteresis memory. Its
    time starts with the first call that has an instant. A voltage is in force when the amplifier's
    output has reached it, so `read_back` lags a write as the output does. `deactivate` sets the
    command to 0 V. The output falls as fast as the amplifier's bandwidth, slew rate and current
    limit allow (150 V take about 5 ms), and it continues to fall without calls.

    Every output is a stage of its own. An input of the same name measures it in µm. With `_v`
    behind the name the input is the uncalibrated voltage of the sensor, with `_light` its light, 1
    at nominal.

    Args:
        options: Options of the rig.
        wiring: Names of the channels, at least one.
        seed: Seed of the specimens, the noise and the calibration's residual; not negative.
    """

    def __init__(self, options: SimulatedOptions, wiring: Wiring, seed: int) -> None:
        self._options = options
        self._wiring = wiring
        self._seed = seed
        inputs = [_axis_and_quantity(name, wiring.outputs) for name in wiring.inputs]
        # Driven axes first, each once: `_driven_axes` relies on this order. An input without an
        # output is a stage that nothing drives.
        self._axes = tuple(dict.fromkeys((*wiring.outputs, *(axis for axis, _ in inputs))))
        self._inputs = [(self._axes.index(axis), quantity) for axis, quantity in inputs]
        self._channels: list[_SimulatedAxis] = []
        self._origin_ns: int | None = None
        self._active = False

    def open(self) -> Identity:
        """Set up the rig. Compiling or loading the physics takes up to a few seconds.

        Raises:
            DeviceError: If it is already open, or a sensor cannot be calibrated.
        """
        if self._channels:
            raise DeviceError("the simulated rig is already open")
        # A seed of its own for each axis: another axis does not change the specimens of the first
        # ones.
        seeds = np.random.SeedSequence(self._seed).spawn(len(self._axes))
        self._channels = [_make_axis(self._options, seed) for seed in seeds]
        self._origin_ns = None
        return Identity(
            maker="piezod",
            model=f"simulated {self._options.variant}",
            serial=f"seed {self._seed}",
            firmware=piezod.__version__,
        )

    def capabilities(self) -> Capabilities:
        """Return axes and highest rate.

        Raises:
            DeviceError: If the rig is not open.
        """
        self._require_open()
        return Capabilities(
            *self._wiring, read_back=True, max_rate_hz=NS_PER_S / SUB_STEP_NS, opens_relaxed=True
        )

    def activate(self, now_ns: int) -> None:
        """Accept writes from now on.

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
            for axis_model in self._channels:
                # Time must not go back, also if the caller's instant is older than the last call.
                axis_model.plant.advance_to(max(t_ns, axis_model.plant.now_ns))
        self._rest()

    def close(self) -> None:
        """Command 0 V and drop the rig."""
        self._rest()
        self._channels = []

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample of each input; invalid if the sensor is saturated. Real-time safe.

        Raises:
            DeviceError: If the rig is not active, or time went back.
        """
        self._require_active()
        t_ns = self._elapsed_ns(now_ns)
        return [self._channels[i].sample(t_ns, now_ns, quantity) for i, quantity in self._inputs]

    def true_position_um(self, now_ns: int) -> Sequence[float]:
        """Return the true displacement of each stage from rest at 0 V, in µm. Real-time safe.

        It is the displacement before the sensor, at the end of the physics' sub-step, at most 50 µs
        from now. Call it after the `read` of the same instant.

        Raises:
            DeviceError: If the rig is not active, or time went back.
        """
        self._require_active()
        t_ns = self._elapsed_ns(now_ns)
        for axis_model in self._channels:
            axis_model.plant.advance_to(t_ns)
        return [self._channels[i].plant.true_displacement_um for i, _ in self._inputs]

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Command a voltage for each axis, in V; all are accepted or none. Real-time safe.

        Returns:
            Whether they were accepted: the rig is active, there is one value for each axis, and
            each is finite and within the amplifier's limits.

        Raises:
            DeviceError: If time went back.
        """
        driven = self._driven_axes
        if not self._active or len(drive_v) != len(driven):
            return False
        # All voltages are checked before one is commanded.
        if not all(map(_SimulatedAxis.takes, driven, drive_v)):
            return False
        t_ns = self._elapsed_ns(now_ns)
        for axis_model, command_v in zip(driven, drive_v, strict=True):
            axis_model.plant.advance_to(t_ns)
            axis_model.plant.command(float(command_v))
        return True

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Measure the output of each amplifier, in V. Real-time safe.

        Raises:
            DeviceError: If the rig is not open, or time went back.
        """
        self._require_open()
        t_ns = self._elapsed_ns(now_ns)
        for axis_model in self._driven_axes:
            axis_model.plant.advance_to(t_ns)
        return [axis_model.plant.drive_v for axis_model in self._driven_axes]

    @property
    def _driven_axes(self) -> "list[_SimulatedAxis]":
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
        for axis_model in self._channels:
            axis_model.plant.command(_REST_V)


def _axis_and_quantity(name: str, outputs: Sequence[str]) -> tuple[str, str]:
    """Return the axis of an input, and the suffix of its quantity; "" is the displacement."""
    for quantity in (_SENSOR_V, _LIGHT):
        if name not in outputs and name.endswith(quantity):
            return name.removesuffix(quantity), quantity
    return name, ""


def _make_axis(options: SimulatedOptions, seed: np.random.SeedSequence) -> _SimulatedAxis:
    # Independent seeds: switching an effect off does not change the other random numbers.
    of_specimen, of_noise, of_calibration = seed.spawn(3)
    parameters = options.plant(of_specimen)
    plant = Plant(parameters, of_noise)
    amplifier, sensor = parameters.amplifier, parameters.sensor
    # The amplifier is limited by its supply, or by its converter times its gain.
    converter_v = amplifier.dac_range_v * amplifier.gain
    return _SimulatedAxis(
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
            return commissioned_curve(plant.ideal_reading_v, travel_um, known.residual_pct, seed)
        case SensorLine():
            return straight_line_curve(plant.ideal_reading_v, travel_um)
        case SensorTable():
            return TableCurve(zip(known.sensor_v, known.position_um, strict=True))


PLUGIN: Final = DriverPlugin(
    name="simulated",
    summary="a simulated stage with amplifier and sensor",
    options_model=SimulatedOptions,
    create=SimulatedRig,
    confirmed_on_hardware=False,
)
