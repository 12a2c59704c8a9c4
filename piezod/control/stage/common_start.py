"""The start of a movement at an instant, so that several stages begin together."""

from typing import Final

from piezod.units import NS_PER_S, s_to_ns

LATEST_S: Final = 30.0
"""Longest wait for a start, in s: as long as a lease lasts without a further request."""


def start_ns(start_s: float | None) -> int:
    """Return the instant of a start in ns; 0 if it is not given."""
    return 0 if start_s is None else s_to_ns(start_s)


def start_refusal(start_s: float | None, t_ns: int, needed_s: float) -> str:
    """Return why a movement cannot begin at an instant; empty if it can.

    Args:
        start_s: The instant, in s of the loop's clock; None for as soon as possible.
        t_ns: Present instant, in ns.
        needed_s: Time that the axis needs to go to the beginning, in s.
    """
    if start_s is None:
        return ""
    left_s = start_s - t_ns / NS_PER_S
    if left_s < 0.0:
        return f"start_s has passed, {-left_s:.3g} s ago: choose a later start"
    if left_s < needed_s:
        return (
            f"start_s is too early (got {left_s:.3g} s ahead): the axis needs {needed_s:.3g} s to "
            "go to the beginning, choose a later start"
        )
    if left_s > LATEST_S:
        return f"start_s is too far ahead (got {left_s:.3g} s), allowed: at most {LATEST_S:g} s"
    return ""
