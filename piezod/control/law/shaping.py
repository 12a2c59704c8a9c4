"""A reference whose corners do not ring the first mechanical mode of the stage.

The reference is known ahead: each value becomes a mean with its two neighbours, one period before
and one after, weighted [a, 1 - 2 a, a]. That moves nothing in time, and for a frequency that turns
by the angle θ in a period it has the gain 1 - 2 a (1 - cos θ): a is chosen for little of it at the
mode, which the held drive meets as what the samples make of it, θ = 2π f T. Source: input shaping,
Singer and Seering 1990.
"""

from collections.abc import Callable
from math import cos, nan, tau
from typing import Final

MOST_SHARE: Final = 0.3
"""Each neighbour counts at most this much, so that a corner stays one."""
LATE_SHARE: Final = 0.25
"""Cycles follow each other if they are one period apart within this part of it."""


def neighbour_share(mode_hz: float | None, period_s: float) -> float:
    """Return a, from 0.25 to 0.3: what takes the mode out, if that is enough; 0 without a mode.

    Args:
        mode_hz: Frequency of the mode, in Hz; None where it is not known.
        period_s: Period of the loop, in s.
    """
    if mode_hz is None:
        return 0.0
    taken_out = 2.0 * (1.0 - cos(tau * mode_hz * period_s))  # of the gain at the mode, for each a
    return MOST_SHARE if MOST_SHARE * taken_out <= 1.0 else 1.0 / taken_out


class CornerFilter:
    """A reference, shaped, asked for once in each cycle.

    The reference itself is asked for one period further ahead, once in each cycle too; the two
    values before are kept. Where a cycle was skipped these are of other times, and asked for anew.

    Args:
        reference: Seconds since its start to µm.
        mode_hz: Frequency of the first mode, in Hz; None leaves the reference as it is.
        period_s: Period of the loop, in s.
    """

    def __init__(
        self, reference: Callable[[float], float], mode_hz: float | None, period_s: float
    ) -> None:
        self._reference, self._period_s = reference, period_s
        self._share = neighbour_share(mode_hz, period_s)
        self._t_s = nan
        self._before = self._here = self._after = nan

    def value(self, t_s: float) -> float:
        """Return the shaped reference, in µm; may be called in the loop.

        Args:
            t_s: Instant, in s since the start of the reference; a period more in each cycle.
        """
        if not self._share:
            return self._reference(t_s)
        period_s, step_s = self._period_s, t_s - self._t_s
        if abs(step_s - period_s) <= LATE_SHARE * period_s:
            self._before, self._here = self._here, self._after
        else:
            self._before, self._here = self._reference(t_s - period_s), self._reference(t_s)
        self._after = self._reference(t_s + period_s)
        self._t_s = t_s
        return self._here + self._share * (self._before - 2.0 * self._here + self._after)
