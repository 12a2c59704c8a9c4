"""One axis of a simulated rig: a plant with the calibration of its sensor."""

from math import isfinite
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.calibration import TableCurve
from piezod.devices.interface import Sample
from piezod.plant.plant import Plant
from piezod_drivers.simulated.calibration import commissioned_curve, straight_line_curve
from piezod_drivers.simulated.options import Commissioned, SensorLine, SensorTable, SimulatedOptions

FloatArray: TypeAlias = npt.NDArray[np.float64]

SENSOR_V: Final = "_v"
"""Behind the name of an axis: the uncalibrated voltage of its sensor."""
LIGHT: Final = "_light"
"""Behind the name of an axis: the light of its sensor, 1 at nominal."""


class SimulatedAxis(NamedTuple):
    """One axis.

    Attributes:
        plant: Its physics.
        calibration: Calibration of its sensor.
        lowest_v: Lowest voltage of the amplifier, in V.
        highest_v: Highest voltage of the amplifier, in V.
        saturated_v: Magnitude of the sensor's voltage from which on it is saturated, in V.
        step_v: Step of the amplifier's converter, in V at its output; 0 if it has none.
    """

    plant: Plant
    calibration: TableCurve
    lowest_v: float
    highest_v: float
    saturated_v: float
    step_v: float

    def sample(self, t_ns: int, now_ns: int, quantity: str) -> Sample:
        """Take a sample at `t_ns` in the plant's time, `now_ns` in the caller's."""
        self.plant.advance_to(t_ns)
        return self.present_sample(now_ns, quantity)

    def present_sample(self, now_ns: int, quantity: str) -> Sample:
        """Take a sample at the present instant of the plant, `now_ns` in the caller's time."""
        if quantity == LIGHT:
            return Sample(now_ns, self.plant.parameters.sensor.light_level, True)
        sensor_v = self.plant.sample()
        valid = abs(sensor_v) < self.saturated_v
        # `beyond` also extrapolates the calibration, because the stage may move beyond the
        # calibrated range.
        return Sample(now_ns, sensor_v if quantity else self.calibration.beyond(sensor_v), valid)

    def takes(self, drive_v: float) -> bool:
        """Return whether the amplifier can output this voltage."""
        return isfinite(drive_v) and self.lowest_v <= drive_v <= self.highest_v


def axis_and_quantity(name: str, outputs: tuple[str, ...]) -> tuple[str, str]:
    """Return the axis of an input, and the suffix of its quantity; "" is the displacement."""
    for quantity in (SENSOR_V, LIGHT):
        if name not in outputs and name.endswith(quantity):
            return name.removesuffix(quantity), quantity
    return name, ""


def make_axis(options: SimulatedOptions, seed: np.random.SeedSequence) -> SimulatedAxis:
    """Draw a specimen of an axis, and calibrate its sensor.

    Args:
        options: Options of the rig.
        seed: Seed of the axis.

    Raises:
        DeviceError: If the sensor cannot be calibrated.
    """
    # Independent seeds: switching an effect off does not change the other random numbers.
    of_specimen, of_noise, of_calibration = seed.spawn(3)
    parameters = options.plant(of_specimen)
    plant = Plant(parameters, of_noise, options.sub_step_ns)
    amplifier, sensor = parameters.amplifier, parameters.sensor
    # The amplifier is limited by its supply, or by its converter times its gain.
    converter_v = amplifier.dac_range_v * amplifier.gain
    return SimulatedAxis(
        plant,
        _calibration(options.known_curve(), plant, of_calibration),
        max(amplifier.output_min_v, -converter_v),
        min(amplifier.output_max_v, converter_v),
        sensor.saturation_v,
        0.0 if np.isinf(amplifier.dac_bits) else 2.0 * converter_v / 2**amplifier.dac_bits,
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
