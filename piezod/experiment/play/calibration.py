"""The part of a true error that is the sensor's: its calibration limits what can be learned."""

from typing import NamedTuple

import numpy as np

from piezod.dynamics.model import ComplexArray
from piezod.experiment.play.record import CountedPeriods
from piezod.hysteresis.memory import FloatArray

_DEGREE = 8
"""Degree of the polynomial that describes a calibration error over the position."""


class SensorLimit(NamedTuple):
    """What the calibration of the sensor does to the true error, in % of the swing."""

    calibration_pct: float  #: Largest calibration error of the sensor within the motion.
    apart_pct: float  #: Largest true error apart from it: what an exact sensor would leave.


def sensor_limit(
    periods: CountedPeriods, command_um: FloatArray, sensor: ComplexArray
) -> SensorLimit:
    """Return what the calibration of the sensor does to the true error; NaN if that is not known.

    The calibration error is the part of the difference of measured and true displacement that
    depends on the position. Noise and lag do not.

    Args:
        periods: Measured and true displacement.
        command_um: (n,) command, in µm.
        sensor: (n // 2 + 1,) response from the displacement to the samples, at each harmonic.
    """
    if not np.isfinite(periods.true_um).all():
        return SensorLimit(np.nan, np.nan)
    measured_um, true_um = (np.mean(each, axis=0) for each in periods)
    seen_um = np.fft.irfft(np.fft.rfft(true_um) * sensor, true_um.size)
    error = np.polynomial.Chebyshev.fit(seen_um, measured_um - seen_um, _DEGREE)
    apart_um = periods.true_um - command_um + error(periods.true_um)
    to_pct = 100.0 / float(np.ptp(command_um))
    return SensorLimit(
        to_pct * float(np.max(np.abs(error(true_um)))), to_pct * float(np.max(np.abs(apart_um)))
    )
