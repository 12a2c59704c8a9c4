"""Conversions between the units used at the edges and those used inside."""

from typing import Final

NS_PER_S: Final = 1_000_000_000


def s_to_ns(t_s: float) -> int:
    """Round seconds to whole nanoseconds, the unit of every instant and period inside.

    Args:
        t_s: Instant or duration in s, finite.
    """
    return round(t_s * NS_PER_S)
