"""Movements: how a reference goes from where it is to where it shall be.

A movement is a function of time, in seconds since its start to µm, and the position at which it
ends. It begins with the position and the speed of the reference before it, and never leaves the
range that positions may have.
"""

from collections.abc import Callable
from math import cos, nan, tau
from typing import Final, NamedTuple

from piezod.control.reference.waveforms import Waveform

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


Reference = Callable[[float], float]
"""Displacement over time: seconds since its start to µm."""

_PEAK: Final = 1.875
"""Highest speed of the smoothest way, over its mean speed."""
_LEAD_IN: Final = 1e-9
"""A waveform that starts closer than this to where the stage is, in µm, needs no way there."""


class Motion(NamedTuple):
    """A movement of one axis.

    Attributes:
        reference_um: Displacement over time since its start, in µm.
        duration_s: When the reference stops moving, in s since its start.
        target_um: Position at which it ends.
    """

    reference_um: Reference
    duration_s: float
    target_um: float


class Pace(NamedTuple):
    """How an axis may move.

    Attributes:
        speed_um_per_s: Highest speed, in µm/s.
        shortest_s: Least time that a way takes, in s: less would ring the stage.
        low_um: Lowest position.
        high_um: Highest position.
    """

    speed_um_per_s: float
    shortest_s: float
    low_um: float
    high_um: float


def rest_at(position_um: float) -> Motion:
    """Return the movement that stays."""
    return Motion(lambda _t_s: position_um, 0.0, position_um)


def way(start_um: float, start_um_per_s: float, target_um: float, pace: Pace) -> Motion:
    """Return the smoothest way to a position: least jerk, from a speed to standstill.

    Args:
        start_um: Where it starts.
        start_um_per_s: How fast the reference moves there.
        target_um: Where it ends.
        pace: How fast it may be. A speed at the start that is in the way may exceed it.

    Source: T. Flash and N. Hogan 1985, the polynomial of fifth degree, acceleration 0 at both ends.
    """
    distance_um = target_um - start_um
    duration_s = max(_PEAK * abs(distance_um) / pace.speed_um_per_s, pace.shortest_s)
    run_um = start_um_per_s * duration_s
    cubic = 10.0 * distance_um - 6.0 * run_um
    quartic = -15.0 * distance_um + 8.0 * run_um
    quintic = 6.0 * distance_um - 3.0 * run_um

    def reference_um(t_s: float) -> float:
        part = t_s / duration_s
        if part >= 1.0:
            return target_um
        if part <= 0.0:
            return start_um
        moved_um = part * (run_um + part * part * (cubic + part * (quartic + part * quintic)))
        return min(max(start_um + moved_um, pace.low_um), pace.high_um)

    return Motion(reference_um, duration_s, target_um)


def along(
    waveform: Waveform, duration_s: float, start_um: float, start_um_per_s: float, pace: Pace
) -> Motion:
    """Return the way to the start of a waveform, the waveform, and then its last value.

    Args:
        waveform: Displacement over time, in µm.
        duration_s: How long it is followed, in s.
        start_um: Where the reference is.
        start_um_per_s: How fast it moves there.
        pace: How fast it may get to the start.
    """
    value, end_um = waveform.value, waveform.value(duration_s)
    first_um = value(0.0)
    lead_in = rest_at(first_um)
    if abs(first_um - start_um) > _LEAD_IN or start_um_per_s:
        lead_in = way(start_um, start_um_per_s, first_um, pace)

    def reference_um(t_s: float) -> float:
        since_s = t_s - lead_in.duration_s
        if since_s < 0.0:
            return lead_in.reference_um(t_s)
        return value(since_s) if since_s < duration_s else end_um

    return Motion(reference_um, lead_in.duration_s + duration_s, end_um)


class StreamedReference:
    """Follows the newest of the setpoints that a program sends, not faster than the axis may move.

    Args:
        start_um: Where the reference is.
        pace: How it may move.
        period_s: Period of the loop, in s.
    """

    def __init__(self, start_um: float, pace: Pace, period_s: float) -> None:
        self._value_um = self.newest_um = start_um
        """Setpoint that came last; finite and within the range, whoever sets it sees to that."""
        self._step_um = pace.speed_um_per_s * period_s

    def advance(self) -> None:
        """Go on by one cycle; call it once in each, in the loop."""
        away_um = self.newest_um - self._value_um
        self._value_um += min(max(away_um, -self._step_um), self._step_um)

    def __call__(self, _t_s: float) -> float:
        """Return the reference of this cycle, in µm; what comes next is not known."""
        return self._value_um
