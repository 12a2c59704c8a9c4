"""Voltages over time that need no model, for state IDENT."""

from collections.abc import Callable
from math import asin, sin, tau
from typing import Final, NamedTuple

from piezod.config.axes import LimitsConfig
from piezod.config.daemon import ConditioningConfig

END_SHARE: Final = 0.01
"""A rest voltage within this share of the range of an end is at that end."""
DriveProgram = Callable[[float], float]
"""Voltage over time: seconds since its start to V."""


class VoltageProgram(NamedTuple):
    """A voltage over time, with an end."""

    drive_v: DriveProgram  #: Voltage over time since its start, in V.
    duration_s: float  #: Time of its end, in s; then its last value is held.


def conditioning(config: ConditioningConfig, limits: LimitsConfig) -> VoltageProgram:
    """Return a sinusoid over the whole range, which starts and ends at the rest voltage.

    Inside the range each swing is smaller than the one before. The largest one erases the
    hysteresis memory, and the others leave a memory that is known. At an end of the range all
    swings are whole, and leave the end of the widest loop: after smaller ones a stage that forgets
    along the path would rest beside it, and a later wide loop would not come back to its zero.
    """
    low_v, high_v, rest_v = limits.drive_min_v, limits.drive_max_v, limits.rest_v
    middle_v, half_v = 0.5 * (low_v + high_v), 0.5 * (high_v - low_v)
    decay = float(half_v - abs(rest_v - middle_v) > END_SHARE * (high_v - low_v))
    phase = asin(min(max((rest_v - middle_v) / half_v, -1.0), 1.0))  # rounding may leave [-1, 1]
    duration_s = config.cycles / config.frequency_hz

    def drive_v(t_s: float) -> float:
        if not 0.0 <= t_s < duration_s:
            return rest_v
        swing_v = middle_v - rest_v + half_v * sin(phase + tau * config.frequency_hz * t_s)
        return rest_v + (1.0 - decay * t_s / duration_s) * swing_v

    return VoltageProgram(drive_v, duration_s)
