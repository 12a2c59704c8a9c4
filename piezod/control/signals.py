"""Small statistics over the last cycles of a signal. Pure, with fixed memory, real-time safe."""

from math import inf, nan
from typing import Final

RANGE_MARGIN: Final = 0.2
"""A position farther outside its range than this share of the range is not physical."""


def is_physical(position: float) -> bool:
    """Return whether a stage can be at a position, in units of the range of its model."""
    return -RANGE_MARGIN <= position <= 1.0 + RANGE_MARGIN


class LeakyBucket:
    """Trips after several errors in a row, or if their share is too large for too long.

    With the default values: five errors in a row, or more than one in three cycles for long.

    Args:
        up: Rise of the level at an error.
        down: Fall of the level in a cycle without an error.
        trip: Level at which the bucket is tripped; the level never exceeds it.
    """

    def __init__(self, up: int = 2, down: int = 1, trip: int = 10) -> None:
        self._up, self._down, self._trip = up, down, trip
        self.level = 0
        """Level now, 0 to `trip`."""

    def update(self, error: bool) -> bool:
        """Take whether this cycle had an error; return whether the bucket is tripped.

        A full bucket is no longer tripped after the first cycle without an error.
        """
        if error:
            self.level = min(self.level + self._up, self._trip)
        elif self.level:
            self.level = max(self.level - self._down, 0)
        return self.level >= self._trip

    def reset(self) -> None:
        """Set the level to zero."""
        self.level = 0


class RecentRange:
    """Lowest and highest value over the last cycles.

    They cover at least the last `cycles` values, and fewer than twice as many. Two blocks of
    `cycles` values replace a sliding window, so that the cost does not depend on the length.

    Args:
        cycles: Length of a block, at least 1.
    """

    def __init__(self, cycles: int) -> None:
        self._cycles = cycles
        self.low, self.high = inf, -inf
        """Lowest and highest value; inf and -inf before the first value."""
        self._low_now, self._high_now = inf, -inf  # of the present block
        self._filled = 0
        self.swing = 0.0
        """Highest minus lowest value; 0 before the first value."""

    def add(self, value: float) -> None:
        """Take the value of this cycle; it must be finite."""
        if self._filled == self._cycles:  # only the block that ends here still counts
            self.low, self.high = self._low_now, self._high_now
            self._low_now, self._high_now = inf, -inf
            self._filled = 0
            self.swing = self.high - self.low
        self._filled += 1
        # Comparisons in place of `min` and `max`: four of these run in each cycle.
        if value < self._low_now:
            self._low_now = value
            if value < self.low:
                self.low = value
                self.swing = self.high - value
        if value > self._high_now:
            self._high_now = value
            if value > self.high:
                self.high = value
                self.swing = value - self.low

    def forget(self) -> None:
        """Forget all values."""
        self.low = self._low_now = inf
        self.high = self._high_now = -inf
        self._filled, self.swing = 0, 0.0


_PARTS = 20  # the window slides by a twentieth of its length


class SlidingRange:
    """Highest minus lowest value over a window that slides by parts.

    The window holds the last `cycles` values, less at most one part: a twentieth of them, or one.

    Args:
        cycles: Length of the window, at least 1.
    """

    def __init__(self, cycles: int) -> None:
        self._part_cycles = max(cycles // _PARTS, 1)
        parts = max(cycles // self._part_cycles, 1)
        self._lows, self._highs = [inf] * parts, [-inf] * parts
        self._low, self._high = inf, -inf  # of all parts
        self._part, self._filled = 0, 0

    def add(self, value: float) -> float:
        """Take the value of this cycle; return the swing."""
        if self._filled == self._part_cycles:
            self._part = (self._part + 1) % len(self._lows)
            self._lows[self._part], self._highs[self._part] = inf, -inf
            self._low, self._high = min(self._lows), max(self._highs)
            self._filled = 0
        self._filled += 1
        part = self._part
        if value < self._lows[part]:
            self._lows[part] = value
            self._low = min(self._low, value)
        if value > self._highs[part]:
            self._highs[part] = value
            self._high = max(self._high, value)
        return self._high - self._low


STUCK_SAMPLES: Final = 20
"""A sensor is stuck if this many samples are equal while the drive moves."""


class StuckSensor:
    """Detects samples that stay equal while the drive moves.

    Args:
        swing: The drive must move meanwhile by more than this share of its range.
    """

    def __init__(self, swing: float) -> None:
        self._swing = swing
        self._position = nan
        self._samples = 0
        self._low = self._high = 0.0

    @property
    def repeated(self) -> bool:
        """Whether the last sample equals the one before: it may be the first of many."""
        return self._samples > 1

    def forget(self) -> None:
        """Start again."""
        self._position = nan

    def update(self, position: float, drive: float) -> bool:
        """Take a sample and the drive in force; return whether the sensor is stuck."""
        if position != self._position:
            self._position, self._samples = position, 1
            self._low = self._high = drive
            return False
        self._samples += 1
        self._low, self._high = min(self._low, drive), max(self._high, drive)
        return self._samples >= STUCK_SAMPLES and self._high - self._low > self._swing


STILL_SAMPLES: Final = 200
"""A sensor stands still if this many samples are equal to the last bit."""
USUAL_CHANGES: Final = 0.5
"""If fewer than this share of the samples differ from the one before, equal samples are normal: the
sensor is coarse or slow."""

_AVERAGED_SAMPLES = 1000


class StillSensor:
    """Detects a sensor that stands still although its samples usually differ."""

    def __init__(self) -> None:
        self._position = nan
        self.samples = 0
        """Number of equal samples in a row."""
        self._changing = 0.0
        self.still = False
        """Whether the sensor stands still although its samples usually differ."""

    def update(self, position: float) -> None:
        """Take a sample."""
        if position != self._position:
            self._position, self.samples, self.still = position, 1, False
            # A slow average of the share of samples that differ from the one before.
            self._changing += (1.0 - self._changing) / _AVERAGED_SAMPLES
            return
        self.samples += 1
        self._changing -= self._changing / _AVERAGED_SAMPLES
        if self.samples == STILL_SAMPLES:
            self.still = self._changing > USUAL_CHANGES


SPIKE_SIGMAS: Final = 6.0
"""A second difference beyond this many standard deviations is a spike; noise alone makes one in 5e8
samples."""
AVERAGED_CYCLES: Final = 200
"""Time constant of the variance, in cycles. Noise that has become ten times larger makes spikes for
about two of these."""
USUAL_CYCLES: Final = 10_000
"""Time constant of the usual variance, in cycles. Noise that has become ten times larger and stays
is usual after about three of these."""
UNUSUAL: Final = 4.0
"""The noise is unusual if its variance exceeds the usual one by this factor, its amplitude by
two."""
START_VARIANCE: Final = 1e-6
"""Variance that is assumed at first: an amplitude of a thousandth of the range."""
LEAST_VARIANCE: Final = 1e-8
"""Smallest variance, an amplitude of a ten-thousandth of the range: without it, any motion would be
a spike for a sensor without noise."""

_SPIKE = SPIKE_SIGMAS**2
_PER_VARIANCE = 1.0 + 4.0 + 1.0  # Σ c² of the second difference, 1, -2, 1
_CLIP = 4.0  # squares count up to this many variances, two sigmas
_CLIP_MEAN = 0.9205  # mean square of normal noise that is clipped so: E min(g², 4)


class NoiseLevel:
    """Estimates the noise of one sensor, from second differences of its positions.

    A smooth motion hardly changes the second difference, so the estimate needs no rest. Clipped
    squares keep spikes out of it.
    """

    def __init__(self) -> None:
        self.variance = START_VARIANCE
        """Variance of the noise of the position, in units of the range squared."""
        self.excess = 1.0
        """Variance of the noise over the usual one."""
        self._usual, self._cycles = START_VARIANCE, AVERAGED_CYCLES
        self._before, self._last = nan, nan

    @property
    def unusual(self) -> bool:
        """Whether the noise is now much larger than usual."""
        return self.excess > UNUSUAL

    def update(self, position: float) -> bool:
        """Take a position, in units of the range; return whether it is part of a spike.

        A single spike shows in three samples: its own and the two after it.
        """
        difference = position - 2.0 * self._last + self._before
        square = difference * difference / _PER_VARIANCE  # `**` would raise for infinity
        self._before, self._last = self._last, position
        if square != square:  # noqa: PLR0124 - NaN until there are three samples
            return False
        variance = self.variance
        # Comparisons in place of `min` and `max`: this runs twice in each cycle.
        most = _CLIP * variance
        clipped = (square if square < most else most) / _CLIP_MEAN
        after = variance + (clipped - variance) / AVERAGED_CYCLES
        self.variance = after = after if after > LEAST_VARIANCE else LEAST_VARIANCE
        if self._cycles < USUAL_CYCLES:  # at first the plain mean
            self._cycles += 1
        # A rise counts up to a factor of two, so that the usual level follows slowly.
        usual = self._usual
        self._usual += ((after if after < 2.0 * usual else 2.0 * usual) - usual) / self._cycles
        self.excess = after / self._usual
        return square > _SPIKE * variance


class OnTarget:
    """Decides whether the measured position of one axis has reached its target. Real-time safe.

    Args:
        tolerance_um: Largest error, in µm.
        settle_cycles: Cycles for which the error must stay within the tolerance.
    """

    def __init__(self, tolerance_um: float, settle_cycles: int) -> None:
        self._tolerance_um, self._settle_cycles = tolerance_um, settle_cycles
        self._cycles = 0

    def restart(self) -> None:
        """Wait for another target."""
        self._cycles = 0

    def update(self, error_um: float) -> bool:
        """Take the error of a cycle, in µm, NaN for none; return whether the target is reached."""
        close = abs(error_um) <= self._tolerance_um
        self._cycles = self._cycles + 1 if close else 0
        return self._cycles > self._settle_cycles
