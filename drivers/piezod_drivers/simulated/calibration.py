"""From the sensor's voltage to a displacement, as measured at commissioning."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from piezod.devices.calibration import TableCurve
from piezod.errors import DeviceError
from piezod.plant.kernel import fibre_v
from piezod.plant.layout import constants
from piezod.plant.parameters import PlantParameters
from piezod.plant.plant import SUB_STEP_NS
from piezod.units import NS_PER_S

MIN_STEPS = 2
"""A converter with fewer steps over the travel does not resolve it."""

_KNOTS = 131
_SWEEP_START, _SWEEP_END = -0.1, 1.2  # range of the sweep at commissioning, in travels


def commissioned_curve(
    ideal_v: Callable[[float], float],
    travel_um: float,
    residual_pct: float,
    seed: np.random.SeedSequence,
) -> TableCurve:
    """Measure the sensor's curve with an imperfect reference.

    Args:
        ideal_v: Returns the sensor's voltage, in V, at a displacement in µm.
        travel_um: Travel of the stage in µm.
        residual_pct: Greatest error of the result over the travel, in % of travel.
        seed: Seed of the shape of this error, which is smooth.

    Raises:
        DeviceError: If the light has its maximum within the sweep, so that no curve exists.
    """
    # The sweep goes beyond the travel, because the stage does too (creep, overshoot).
    position = np.linspace(_SWEEP_START, _SWEEP_END, _KNOTS)
    sensor_v = _monotonic(ideal_v, position * travel_um)
    error = _smooth_error(position, seed) * residual_pct / 100
    return _curve(sensor_v, (position + error) * travel_um)


def check_sensor(parameters: PlantParameters) -> None:
    """Refuse a sensor that cannot measure the travel.

    Raises:
        DeviceError: If it is saturated at rest, or its converter does not resolve the travel.
    """
    record = constants(parameters, SUB_STEP_NS / NS_PER_S)
    travel_um = np.linspace(0, parameters.stage.travel_um, _KNOTS)
    # The ideal output, without noise.
    sensor_v = [fibre_v(float(x), record) for x in travel_um]
    saturation_v, step_v = (float(record[0][name]) for name in ("saturation_v", "adc_step_v"))
    if sensor_v[0] >= saturation_v:
        raise DeviceError(
            f"the sensor is saturated at rest: it outputs {sensor_v[0]:g} V, allowed: less than "
            f"saturation_v, {saturation_v:g} V"
        )
    span_v = max(sensor_v) - min(sensor_v)
    if span_v == 0 or MIN_STEPS * step_v > span_v:
        raise DeviceError(
            f"the sensor does not resolve the travel: its output changes by {span_v:g} V, its "
            f"converter has steps of {step_v:g} V, allowed: at least {MIN_STEPS} steps"
        )


def _curve(sensor_v: Sequence[float], position_um: Any) -> TableCurve:
    return TableCurve(zip(sensor_v, map(float, position_um), strict=True))


def _monotonic(ideal_v: Callable[[float], float], position_um: Any) -> list[float]:
    sensor_v = [ideal_v(float(x)) for x in position_um]
    steps = np.diff(sensor_v)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise DeviceError(
            "the sensor cannot be calibrated: its voltage is not monotonic over the travel"
        )
    return sensor_v


def _smooth_error(position: Any, seed: np.random.SeedSequence) -> Any:
    rng = np.random.default_rng(seed)
    # Four harmonics of half the travel, each weaker than the one before: a smooth error.
    waves = np.arange(1, 5)
    strength, phase = rng.standard_normal(4) / waves, rng.uniform(0, 2 * np.pi, 4)
    error = np.sin(np.pi * np.outer(position, waves) + phase) @ strength
    # Scaled so that the greatest error within the travel is 1.
    inside = (position >= 0) & (position <= 1)
    return error / np.max(np.abs(error[inside]))


def straight_line_curve(ideal_v: Callable[[float], float], travel_um: float) -> TableCurve:
    """Fit a line by least squares, for a sensor without calibration.

    Args:
        ideal_v: Returns the sensor's voltage, in V, at a displacement in µm.
        travel_um: Travel of the stage in µm.

    Raises:
        DeviceError: If the light has its maximum within the travel, so that no line fits.
    """
    position_um = np.linspace(0, travel_um, 401)
    sensor_v = np.array(_monotonic(ideal_v, position_um))
    line = np.polynomial.Polynomial.fit(sensor_v, position_um, 1)
    ends = sensor_v[[0, -1]]
    return _curve(list(ends), line(ends))
