"""One axis of a simulated rig: a plant with the calibration of its sensor."""

from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.calibration import TableCurve
from piezod.plant.plant import Plant
from piezod_drivers.simulated.calibration import commissioned_curve, straight_line_curve
from piezod_drivers.simulated.options import Commissioned, SensorLine, SensorTable, SimulatedOptions

FloatArray: TypeAlias = npt.NDArray[np.float64]

SENSOR_V: Final = "_v"
"""Behind the name of an axis: the uncalibrated voltage of its sensor."""
LIGHT: Final = "_light"
"""Behind the name of an axis: the light of its sensor, 1 at nominal."""
PHOTONS: Final = "photons"
"""Name of an input that is no axis: the counts of a detector over a test pattern."""


class SimulatedAxis(NamedTuple):
    """One axis."""

    plant: Plant  #: Its physics.
    calibration: TableCurve  #: Calibration of its sensor.
    lowest_v: float  #: Lowest voltage of the amplifier, in V.
    highest_v: float  #: Highest voltage of the amplifier, in V.
    saturated_v: float  #: Magnitude of the sensor's voltage from which on it is saturated, in V.
    step_v: float  #: Step of the amplifier's converter, in V at its output; 0 if it has none.

    def samples(self, readings_v: FloatArray, quantity: str) -> FloatArray:
        """Return the samples of readings of the sensor in V, shape (n,); NaN if not valid."""
        if quantity == LIGHT:
            return np.full(readings_v.size, self.plant.parameters.sensor.light_level)
        values = readings_v
        if not quantity:
            calibrated = map(self.calibration.beyond, readings_v.tolist())
            values = np.fromiter(calibrated, np.float64, readings_v.size)
        return np.where(np.abs(readings_v) < self.saturated_v, values, np.nan)


def axis_and_quantity(name: str, outputs: tuple[str, ...]) -> tuple[str, str]:
    """Return the axis of an input, and the suffix of its quantity; "" is the displacement."""
    if name == PHOTONS and outputs:
        return outputs[0], PHOTONS
    for quantity in (SENSOR_V, LIGHT):
        if name not in outputs and name.endswith(quantity):
            return name.removesuffix(quantity), quantity
    return name, ""


def make_axis(options: SimulatedOptions, seed: np.random.SeedSequence) -> SimulatedAxis:
    """Draw a specimen of an axis, and calibrate its sensor.

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
