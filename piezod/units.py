"""Conversions between the units of interfaces and the units inside."""

from typing import Final

NS_PER_S: Final = 1_000_000_000


def to_ascii(unit: str) -> str:
    """Return a unit for programs that know no µ."""
    return unit.replace("µ", "u")


def s_to_ns(t_s: float) -> int:
    """Return seconds rounded to whole nanoseconds, the unit of all instants and periods inside.

    Args:
        t_s: Instant or duration in s, finite.
    """
    return round(t_s * NS_PER_S)
