"""The limits of the motion of an axis, from its configuration."""

from typing import Final

from piezod.config.daemon import StageAxisConfig
from piezod.control.reference.motion import MotionLimits

SHORTEST_MOTION_PERIODS: Final = 3.0
"""Shortest duration of a movement, in periods of the first mode."""
SHORTEST_MOTION_CYCLES: Final = 10
"""Shortest duration of a movement, in cycles."""


def motion_limits(
    config: StageAxisConfig, range_um: tuple[float, float], period_s: float
) -> MotionLimits:
    """Return the limits of the motion of an axis.

    Args:
        config: Configuration of the axis.
        range_um: Lowest and highest position that may be commanded, in µm.
        period_s: Period of the loop, in s.
    """
    shortest_s = SHORTEST_MOTION_CYCLES * period_s
    if config.first_mode is not None:
        shortest_s = max(shortest_s, SHORTEST_MOTION_PERIODS / config.first_mode.frequency_hz)
    return MotionLimits(config.speed_um_per_s, shortest_s, *range_um)
