"""Small statistics over the last cycles of a signal; pure, with fixed memory."""

from math import inf, nan
from typing import Final


class LeakyBucket:
    """Trips at so many errors in a row, or where they are more than a share for long.

    With the values below: five in a row, or for long more than one in three.

    Args:
        up: What an error fills in.
        down: What leaks out in a cycle without one.
        trip: The level from which on it is tripped; the bucket holds no more than that.
    """

    def __init__(self, up: int = 2, down: int = 1, trip: int = 10) -> None:
        self._up, self._down, self._trip = up, down, trip
        self.level = 0
        """What is in it now, 0 to `trip`."""

    def update(self, error: bool) -> bool:
        """Take whether this cycle had an error; return whether it is tripped; call it in the loop.

        Being full, it is no longer tripped after the first cycle without an error.
        """
        if error:
            self.level = min(self.level + self._up, self._trip)
        elif self.level:
            self.level = max(self.level - self._down, 0)
        return self.level >= self._trip

    def reset(self) -> None:
        """Empty it; may be called in the loop."""
        self.level = 0


class RecentRange:
    """Lowest and highest value over the last cycles: over `cycles` at least, under twice as many.

    Args:
        cycles: At least 1.
    """

    def __init__(self, cycles: int) -> None:
        self._cycles = cycles
        self.low, self.high = inf, -inf
        """Lowest and highest value; the lowest is the larger where there was none yet."""
        self._low_now, self._high_now = inf, -inf
        self._low_before, self._high_before = inf, -inf
        self._filled = 0

    @property
    def swing(self) -> float:
        """Highest minus lowest value, at least 0."""
        return max(self.high - self.low, 0.0)

    def add(self, value: float) -> None:
        """Take the value of this cycle, finite; may be called in the loop."""
        if self._filled == self._cycles:
            self._low_before, self._high_before = self._low_now, self._high_now
            self._low_now = self._high_now = value
            self._filled = 0
        self._filled += 1
        self._low_now, self._high_now = min(self._low_now, value), max(self._high_now, value)
        self.low = min(self._low_before, self._low_now)
        self.high = max(self._high_before, self._high_now)

    def forget(self) -> None:
        """Forget all values; may be called in the loop."""
        self.low = self._low_before = self._low_now = inf
        self.high = self._high_before = self._high_now = -inf
        self._filled = 0


_PARTS = 20  # the window slides by a twentieth of its length


class SlidingRange:
    """Highest minus lowest value over a window that slides by parts.

    The window holds the last `cycles` values, less at most a part: a twentieth of them, or one.

    Args:
        cycles: Length of the window; at least 1.
    """

    def __init__(self, cycles: int) -> None:
        self._part_cycles = max(cycles // _PARTS, 1)
        parts = max(cycles // self._part_cycles, 1)
        self._lows, self._highs = [inf] * parts, [-inf] * parts
        self._part, self._filled = 0, 0

    def add(self, value: float) -> float:
        """Take the value of this cycle; return the swing. May be called in the loop.

        Args:
            value: Finite.
        """
        if self._filled == self._part_cycles:
            self._part = (self._part + 1) % len(self._lows)
            self._lows[self._part], self._highs[self._part] = inf, -inf
            self._filled = 0
        self._filled += 1
        self._lows[self._part] = min(self._lows[self._part], value)
        self._highs[self._part] = max(self._highs[self._part], value)
        return max(self._highs) - min(self._lows)


STUCK_SAMPLES: Final = 20
"""A sensor is stuck when this many samples are the same."""


class StuckSensor:
    """Watches for samples that stay the same while the drive moves.

    Args:
        swing: By more than this the drive has to move meanwhile, as a share of its range.
    """

    def __init__(self, swing: float) -> None:
        self._swing = swing
        self._position = nan
        self._samples = 0
        self._low = self._high = 0.0

    @property
    def repeated(self) -> bool:
        """Whether the last sample was the same as the one before: it may be the first of many."""
        return self._samples > 1

    def forget(self) -> None:
        """Begin anew; may be called in the loop."""
        self._position = nan

    def update(self, position: float, drive: float) -> bool:
        """Take a sample and the drive in force; return whether the sensor is stuck.

        May be called in the loop.
        """
        if position != self._position:
            self._position, self._samples = position, 0
            self._low = self._high = drive
        self._samples += 1
        self._low, self._high = min(self._low, drive), max(self._high, drive)
        return self._samples >= STUCK_SAMPLES and self._high - self._low > self._swing


STILL_SAMPLES: Final = 200
"""So many samples that are the same to the bit are still."""
USUALLY: Final = 0.5
"""Where less than this part of the samples differs from the one before, none is expected to."""

_AVERAGED_SAMPLES = 1000


class StillSensor:
    """Watches one sensor; fixed memory."""

    def __init__(self) -> None:
        self._position = nan
        self.samples = 0
        """How many samples in a row have been the same."""
        self._changing = 0.0
        self.still = False
        """Whether the sensor stands still though it usually does not."""

    def update(self, position: float) -> None:
        """Take a sample; may be called in the loop."""
        if position != self._position:
            self._position, self.samples, self.still = position, 1, False
            self._changing += (1.0 - self._changing) / _AVERAGED_SAMPLES
            return
        self.samples += 1
        self._changing -= self._changing / _AVERAGED_SAMPLES
        if self.samples == STILL_SAMPLES:
            self.still = self._changing > USUALLY


SPIKE_SIGMAS: Final = 6.0
"""A second difference beyond this is a spike; noise alone gives one in 5e8 samples."""
AVERAGED_CYCLES: Final = 200
"""Time constant of the level. After noise has become ten times larger it takes about two of these
until that is no spike any more."""
USUAL_CYCLES: Final = 10_000
"""Time constant of what is usual. Noise that has become ten times larger and stays is called usual
after about three of these."""
UNUSUAL: Final = 4.0
"""A variance of so many times the usual one, twice its amplitude, is unusual."""
START_VARIANCE: Final = 1e-6
"""What the noise is taken for at first: a thousandth of the range."""
LEAST_VARIANCE: Final = 1e-8
"""The level stays above this, a ten-thousandth of the range, so that a sensor without noise does
not make a spike of every motion."""

_PER_VARIANCE = 1.0 + 4.0 + 1.0  # squares of the second difference's coefficients
_CUT = 4.0  # squares count up to this many times the level, two sigmas
_CUT_MEAN = 0.9205  # what is left of the mean square of normal noise, so cut: E min(g², 4)


class NoiseLevel:
    """Follows the noise of one sensor, in squares of the unit of its displacement's range."""

    def __init__(self) -> None:
        self.variance = START_VARIANCE
        """Variance of the displacement's noise; a robust, slow average."""
        self._usual, self._cycles = START_VARIANCE, AVERAGED_CYCLES
        self._before, self._last = nan, nan

    @property
    def unusual(self) -> bool:
        """Whether the noise is now much larger than it usually is."""
        return self.excess > UNUSUAL

    @property
    def excess(self) -> float:
        """How many times its usual variance the noise has now."""
        return self.variance / self._usual

    def update(self, position: float) -> bool:
        """Take a displacement, in units of the range; return whether it is part of a spike.

        A single spike is seen in three samples: the one that has it and two after it. May be called
        in the loop.
        """
        difference = position - 2.0 * self._last + self._before
        square = difference * difference / _PER_VARIANCE  # `**` would raise where this is infinite
        self._before, self._last = self._last, position
        if square != square:  # noqa: PLR0124 - not a number before there are three samples
            return False
        level = self.variance
        cut = min(square, _CUT * level) / _CUT_MEAN
        self.variance = max(level + (cut - level) / AVERAGED_CYCLES, LEAST_VARIANCE)
        self._cycles = min(self._cycles + 1, USUAL_CYCLES)  # at first it is the plain mean
        self._usual += (min(self.variance, 2.0 * self._usual) - self._usual) / self._cycles
        return square > SPIKE_SIGMAS**2 * level
