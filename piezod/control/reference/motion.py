"""Movements: how a reference gets from one position to another.

A movement is a function of time, in seconds since its start to µm, with the position at which it
ends. It starts with the position and the speed of the reference before it, and never leaves the
allowed range of positions.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import accumulate
from math import cos, isfinite, nan, tau
from typing import Final, NamedTuple

from piezod.config.daemon import StageAxisConfig
from piezod.config.waveforms.waveform import Waveform

MAX_SHARE: Final = 0.3
"""Largest weight of each neighbour: a larger one would smooth more than the corners."""
PERIOD_TOLERANCE: Final = 0.25
"""Two cycles are consecutive if they are one period apart, within this share of it."""


def neighbour_share(mode_hz: float | None, period_s: float) -> float:
    """Return the weight a of the neighbours, 0.25 to 0.3; 0 without a mode.

    The filter a, 1 - 2 a, a has the gain 1 - 2 a (1 - cos ω T) at the frequency ω. The weight makes
    it 0 at the mode, or as small as MAX_SHARE allows.

    Args:
        mode_hz: Frequency of the mode, in Hz; None if it is unknown.
        period_s: Period of the loop, in s.
    """
    if mode_hz is None:
        return 0.0
    loss_per_share = 2.0 * (1.0 - cos(tau * mode_hz * period_s))  # loss of gain at the mode, per a
    return MAX_SHARE if MAX_SHARE * loss_per_share <= 1.0 else 1.0 / loss_per_share


class CornerFilter:
    """A reference with smoothed corners, which do not ring the first mode. Real-time safe.

    Call `value` once per cycle. It evaluates the reference once, one period further ahead, and
    keeps the two values before. After a skipped cycle these belong to other times, and are
    evaluated again.

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
        """Return the smoothed reference, in µm.

        Args:
            t_s: Instant, in s since the start of the reference; one period more in each cycle.
        """
        if not self._share:
            return self._reference(t_s)
        period_s, step_s = self._period_s, t_s - self._t_s
        # A late cycle shifts the times a little; a skipped one makes the kept values useless.
        if abs(step_s - period_s) <= PERIOD_TOLERANCE * period_s:
            self._before, self._here = self._here, self._after
        else:
            self._before, self._here = self._reference(t_s - period_s), self._reference(t_s)
        self._after = self._reference(t_s + period_s)
        self._t_s = t_s
        return self._here + self._share * (self._before - 2.0 * self._here + self._after)


Reference = Callable[[float], float]
"""Position over time: seconds since its start to µm."""

PEAK: Final = 1.875
"""Highest speed of a minimum-jerk motion from rest to rest, over its mean speed: 15/8."""
SHORTEST_MOTION_PERIODS: Final = 3.0
"""Shortest duration of a movement, in periods of the first mode."""
SHORTEST_MOTION_CYCLES: Final = 10
"""Shortest duration of a movement, in cycles."""
_SAME_UM: Final = 1e-9
"""A waveform that starts closer than this to the reference needs no lead-in, in µm."""


class Motion(NamedTuple):
    """A movement of one axis."""

    reference_um: Reference  #: Position over time since its start, in µm.
    duration_s: float  #: Time at which the reference stops, in s since its start.
    target_um: float  #: Position at which it ends, in µm.


class MotionLimits(NamedTuple):
    """Limits of the motion of an axis."""

    speed_um_per_s: float  #: Highest speed, in µm/s.
    shortest_s: float  #: Shortest duration of a movement, in s; a shorter one would ring the stage.
    low_um: float  #: Lowest position, in µm.
    high_um: float  #: Highest position, in µm.

    def allow(self, position_um: float) -> bool:
        """Return whether a position may be commanded: it is finite and in the range."""
        return isfinite(position_um) and self.low_um <= position_um <= self.high_um

    def refusal(self, low_um: float, high_um: float, unit: str = "µm") -> str:
        """Return why positions in a range may not be commanded; empty if they may.

        Args:
            low_um: Lowest position, in µm.
            high_um: Highest position, in µm.
            unit: Unit of all of them, of a user axis: µm or µrad.
        """
        slack_um = 1e-9 * (self.high_um - self.low_um)  # bounds are sums, with rounding errors
        if low_um >= self.low_um - slack_um and high_um <= self.high_um + slack_um:
            return ""
        # With all digits: a value that is hardly too large would look like the bound.
        got = f"{low_um:.12g}" if low_um == high_um else f"{low_um:.12g} to {high_um:.12g}"
        allowed = f"allowed range {self.low_um:g} to {self.high_um:g} {unit}"
        return f"position out of range (got {got} {unit}), {allowed}"


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


def rest_at(position_um: float) -> Motion:
    """Return the movement that stays at a position."""
    return Motion(lambda _t_s: position_um, 0.0, position_um)


def moving_s(way_um: float, limits: MotionLimits) -> float:
    """Return how long a movement from rest to rest takes, in s."""
    return max(PEAK * abs(way_um) / limits.speed_um_per_s, limits.shortest_s)


def smooth_motion(
    start_um: float, start_um_per_s: float, target_um: float, limits: MotionLimits
) -> Motion:
    """Return the smoothest motion to a position: minimum jerk, from a speed to standstill.

    Source: T. Flash and N. Hogan, J. Neurosci. 5 (1985): a polynomial of the fifth degree, with
    acceleration 0 at both ends.

    Args:
        start_um: Position at the start, in µm.
        start_um_per_s: Speed of the reference at the start, in µm/s.
        target_um: Position at the end, in µm.
        limits: Limits of the motion. A speed at the start against the motion may lead to a higher
            one.
    """
    distance_um = target_um - start_um
    duration_s = moving_s(distance_um, limits)
    initial_run_um = start_um_per_s * duration_s
    # Coefficients for position and speed at the start, position at the end, and 0 for the others.
    cubic = 10.0 * distance_um - 6.0 * initial_run_um
    quartic = -15.0 * distance_um + 8.0 * initial_run_um
    quintic = 6.0 * distance_um - 3.0 * initial_run_um

    def reference_um(t_s: float) -> float:
        part = t_s / duration_s
        if part >= 1.0:
            return target_um
        if part <= 0.0:
            return start_um
        moved_um = part * (
            initial_run_um + part * part * (cubic + part * (quartic + part * quintic))
        )
        # A speed towards an end of the range would carry the polynomial beyond it.
        return min(max(start_um + moved_um, limits.low_um), limits.high_um)

    return Motion(reference_um, duration_s, target_um)


def rejoin(motion: Motion, elapsed_s: float, start_um: float, limits: MotionLimits) -> Motion:
    """Return the rest of a movement, from a position that is off its reference.

    The offset fades with the least jerk, so that position and speed are continuous.

    Args:
        motion: The movement.
        elapsed_s: Time since its start, in s.
        start_um: Position now, in µm.
        limits: Limits of the motion.
    """
    offset_um = start_um - motion.reference_um(elapsed_s)
    fade_s = moving_s(offset_um, limits)

    def reference_um(t_s: float) -> float:
        planned_um, part = motion.reference_um(elapsed_s + t_s), t_s / fade_s
        if part >= 1.0:
            return planned_um
        faded = 1.0 - part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        return min(max(planned_um + offset_um * faded, limits.low_um), limits.high_um)

    return Motion(reference_um, max(motion.duration_s - elapsed_s, fade_s), motion.target_um)


def joined(motions: Sequence[Motion]) -> Motion:
    """Return movements one after the other; each begins where the one before it ends."""
    ends_s = list(accumulate(motion.duration_s for motion in motions))

    def reference_um(t_s: float) -> float:
        index = min(bisect_right(ends_s, t_s), len(motions) - 1)
        return motions[index].reference_um(t_s - (ends_s[index] - motions[index].duration_s))

    return Motion(reference_um, ends_s[-1], motions[-1].target_um)


def lead_in(
    waveform: Waveform, start_um: float, start_um_per_s: float, limits: MotionLimits
) -> Motion:
    """Return the motion to the start of a waveform.

    Args:
        waveform: Position over time, in µm.
        start_um: Position of the reference, in µm.
        start_um_per_s: Speed of the reference, in µm/s.
        limits: Limits of the motion.
    """
    first_um = waveform.value(0.0)
    # A reference that moves needs a lead-in even at the right position, to take over its speed.
    if abs(first_um - start_um) > _SAME_UM or start_um_per_s:
        return smooth_motion(start_um, start_um_per_s, first_um, limits)
    return rest_at(first_um)


def waveform_motion(
    waveform: Waveform, duration_s: float, before: Motion, begins_s: float = 0.0
) -> Motion:
    """Return the motion to the start of a waveform, the waveform, and then its last value.

    Args:
        waveform: Position over time, in µm.
        duration_s: Duration of the waveform, in s.
        before: The motion to its start, from `lead_in`.
        begins_s: Earliest time at which the waveform begins, in s since the start of the motion.
    """
    value, end_um = waveform.value, waveform.value(duration_s)
    begins_s = max(begins_s, before.duration_s)

    def reference_um(t_s: float) -> float:
        since_s = t_s - begins_s
        if since_s < 0.0:
            return before.reference_um(t_s)
        return value(since_s) if since_s < duration_s else end_um

    return Motion(reference_um, begins_s + duration_s, end_um)


class UnknownFuture:
    """A reference whose later values are unknown: it returns the present one for them."""


class StreamedReference(UnknownFuture):
    """Follows the newest setpoint of a stream, no faster than the axis may move. Real-time safe.

    Args:
        start_um: Position of the reference, in µm.
        limits: Limits of the motion.
        period_s: Period of the loop, in s.
    """

    def __init__(self, start_um: float, limits: MotionLimits, period_s: float) -> None:
        self._value_um = self.newest_um = start_um
        """Newest setpoint, in µm; the caller ensures that it is finite and in the range."""
        self._step_um = limits.speed_um_per_s * period_s

    def advance(self) -> None:
        """Advance the reference by one cycle. Call once per cycle."""
        distance_um = self.newest_um - self._value_um
        self._value_um += min(max(distance_um, -self._step_um), self._step_um)

    def __call__(self, _t_s: float) -> float:
        """Return the reference of this cycle, in µm; later values are unknown."""
        return self._value_um
