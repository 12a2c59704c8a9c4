"""The noise of a displacement while it moves, and the spikes in it, from its second difference.

The second difference x_k - 2 x_{k-1} + x_{k-2} hardly sees a stage that moves slowly against the
loop, and of white noise it has six times the variance. Its mean square is followed by a slow
average that cuts each square at a few times the present level: a spike cannot raise the level by
much, while noise that stays larger raises it within a few of the average's time constants. What it
usually is, a slower average of the level tells; it grows no faster than by its own size in its time
constant.
"""

from math import nan
from typing import Final

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
