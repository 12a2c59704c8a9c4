"""A part of the displacement that relaxes along the path of the drive.

A memory of turning points forgets only by later turning points, so that its loops close. A part of
a stage may instead forget with each piece of the path that the drive has travelled, up or down; its
loops close only after some cycles. This is the state h of the Bouc-Wen model,

    dh = dz - (b |dz| h + g dz |h|) |h/h_s|^(n-1),   b > |g|,   h_s = 1/(b + g),   n >= 1,

of the drive z. With n = 1, h approaches its saturation h_s exponentially on a monotone move, and
with the constant b - g in place of b + g until it passes zero. With a larger n a small h hardly
relaxes; then the equation is integrated. The term adds w (h - h_0), with h_0 at rest,
after many cycles of the whole range. It sees the drive behind a backlash: noise, a long path of
small moves, must not erase h.

Source: Wen, J. Eng. Mech. 102 (1976) 249; for piezoelectric actuators Low and Guo, J.
Microelectromech. Syst. 4 (1995) 230. The paper has no such term.
"""

from dataclasses import dataclass
from math import ceil, exp, log, log1p
from typing import Final

import numpy as np

from piezod.hysteresis.memory import CHANGE, PINNED, FloatArray
from piezod.jit import compiled

WEIGHT, FAST, SLOW, AT_REST, EXPONENT = 3, 4, 5, 6, 7
"""Indices of the constants of the term, behind those of `rate_lag`: w, b + g, b - g, h_0 and n. All
are 0 without the term."""
BACKLASH = 1e-4
"""Moves up to this distance on either side leave h as it is, as a share of the drive's range. It is
fixed: more than the noise of a drive, and less than a record shows."""
NO_PATH: Final[FloatArray] = np.zeros(5)
"""Constants without the term."""
_CYCLES = 60
"""Cycles of the whole range that end at rest; the slowest relaxation needs no more."""
_LEFT = 0.01
"""Part of a difference of h from its rest that conditioning may leave."""
_STEPS = 16.0
"""Steps of the integration per length of path 1/(b + |g|); its error is below 1e-7 of h_s,
and below 1e-4 where h passes zero with an exponent near one."""


@compiled
def risen(h: float, rise: float, fast: float, slow: float, exponent: float) -> float:
    """Return h after the drive has risen; a fall is the same for -h. Real-time safe.

    Args:
        h: At the start.
        rise: Change of the drive in ranges, not negative.
        fast: b + g.
        slow: b - g.
        exponent: n.
    """
    if exponent != 1.0:
        return _integrated(h, rise, fast, slow, exponent)
    if h < 0.0:
        to_zero = log1p(-h * slow) / slow
        if rise <= to_zero:
            return 1.0 / slow + (h - 1.0 / slow) * exp(-slow * rise)
        rise -= to_zero
        h = 0.0
    return 1.0 / fast + (h - 1.0 / fast) * exp(-fast * rise)


@compiled
def _integrated(h: float, rise: float, fast: float, slow: float, exponent: float) -> float:
    """Return h as `risen`, by the method of Runge and Kutta.

    Whole steps, then the rest: so h is a continuous function of the rise, which can be inverted.
    """
    step = 1.0 / (_STEPS * max(fast, slow))
    whole = int(rise / step)
    for _ in range(whole):
        h = _stepped(h, step, fast, slow, exponent)
    return _stepped(h, rise - whole * step, fast, slow, exponent)


@compiled
def _stepped(h: float, step: float, fast: float, slow: float, exponent: float) -> float:
    """Return h after one step of the integration."""
    first = _rise_slope(h, fast, slow, exponent)
    second = _rise_slope(h + 0.5 * step * first, fast, slow, exponent)
    third = _rise_slope(h + 0.5 * step * second, fast, slow, exponent)
    fourth = _rise_slope(h + step * third, fast, slow, exponent)
    return h + step * (first + 2.0 * second + 2.0 * third + fourth) / 6.0


@compiled
def _rise_slope(h: float, fast: float, slow: float, exponent: float) -> float:
    """Return dh/dz on a rise; on a fall it is that of -h."""
    relaxed = h * (fast if h >= 0.0 else slow)
    if exponent != 1.0:
        relaxed *= (fast * abs(h)) ** (exponent - 1.0)
    return 1.0 - relaxed


@compiled
def path_change(terms: FloatArray, last: FloatArray, drive: float) -> tuple[float, float]:
    """Return h - h_0 after a monotone move to a drive, and dh/dz there. Real-time safe.

    Args:
        terms: (8,) constants of the optional terms of a surface.
        last: (4,) `Memory.last` before the move.
        drive: Where the move ends.
    """
    if terms[FAST] == 0.0:
        return 0.0, 0.0
    move = drive - last[PINNED]
    if abs(move) <= BACKLASH:
        return last[CHANGE], 0.0
    sign = 1.0 if move > 0.0 else -1.0
    start = sign * (last[CHANGE] + terms[AT_REST])
    rise = abs(move) - BACKLASH
    h = risen(start, rise, terms[FAST], terms[SLOW], terms[EXPONENT])
    return sign * h - terms[AT_REST], _slope(terms, h)


@compiled
def _slope(terms: FloatArray, h: float) -> float:
    return _rise_slope(h, terms[FAST], terms[SLOW], terms[EXPONENT])


@compiled
def relaxation_slope(terms: FloatArray, last: FloatArray, rising: bool) -> float:
    """Return dh/dz of the present branch after the last drive. Real-time safe."""
    if terms[FAST] == 0.0:
        return 0.0
    h = last[CHANGE] + terms[AT_REST]
    return _slope(terms, h if rising else -h)


@compiled
def advance_path(terms: FloatArray, last: FloatArray, drive: float) -> None:
    """Advance the state in `Memory.last` by one drive. Real-time safe."""
    if terms[FAST] != 0.0:
        last[CHANGE], _ = path_change(terms, last, drive)
        last[PINNED] = min(max(last[PINNED], drive - BACKLASH), drive + BACKLASH)


@dataclass(frozen=True)
class PathRelaxation:
    """The parameters of the term."""

    weight: float  #: w, displacement per change of h, both in units of the range.
    decay: float  #: b, relaxation per path, above 0, in 1/range of the drive.
    skew: (
        float  #: g/b, between -1 and 1: how much faster h relaxes on its way from zero than to it.
    )
    exponent: float = 1.0  #: n, at least 1: the larger, the less a small h relaxes.

    @property
    def constants(self) -> FloatArray:
        """Constants for the kernels, shape (5,), see `WEIGHT`."""
        fast, slow, exponent = self._equation
        return np.array([self.weight, fast, slow, self.at_rest, exponent])

    @property
    def rise(self) -> float:
        """Displacement that the term adds while the drive rises from rest over its range."""
        h = risen(self.at_rest, 1.0 - BACKLASH, *self._equation)
        return self.weight * (h - self.at_rest)

    @property
    def reach(self) -> float:
        """Largest distance between two displacements of the term, since |h| ≤ 1/(b + g)."""
        return 2.0 * abs(self.weight) / self._equation[0]

    def range_at(self, drives: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest displacement of the term at drives, (n,) each.

        h is largest after a rise from 0 at the lowest drive, and smallest after a fall from 0 at
        the highest: at the ends it has the sign of the move that led there, and a move back takes
        more from h than the move has given.
        """
        ends = [
            (-risen(0.0, 1.0 - drive, *self._equation), risen(0.0, drive, *self._equation))
            for drive in drives.tolist()
        ]
        both = self.weight * (np.array(ends) - self.at_rest)
        return both.min(axis=1), both.max(axis=1)

    @property
    def least_slope(self) -> float:
        """The smallest slope that the term adds to a branch: at a turn from saturation, or 0.

        Its slope is w dh/dz. Since |h| ≤ 1/(b + g), dh/dz lies between 0 and 2 b/(b + g).
        """
        return min(0.0, self.weight * steepest_relaxation(self.skew))

    @property
    def _equation(self) -> tuple[float, float, float]:
        """Return b + g, b - g and n."""
        return self.decay * (1.0 + self.skew), self.decay * (1.0 - self.skew), self.exponent

    @property
    def cycles_to_rest(self) -> int:
        """Cycles of the whole range that make any difference of h smaller by the factor `_LEFT`.

        On any path differences shrink at least as fast as with the smaller of b + g and b - g if n
        is 1. Otherwise the largest difference, of both saturations, is followed.
        """
        fast, slow, exponent = self._equation
        if exponent == 1.0:
            return min(ceil(-log(_LEFT) / (2.0 * min(fast, slow))), _CYCLES)
        ends = [-1.0 / fast, 1.0 / fast]
        for cycle in range(_CYCLES):
            if ends[1] - ends[0] <= 2.0 * _LEFT / fast:
                return cycle
            ends = [_cycled(h, fast, slow, exponent) for h in ends]
        return _CYCLES

    @property
    def at_rest(self) -> float:
        """h_0, after many cycles of the whole range."""
        return _at_rest(*self._equation)


@compiled
def _at_rest(fast: float, slow: float, exponent: float) -> float:
    # A rise over the range leads from h_0 to -h_0, whatever the sign of g. The mean of h and its
    # mirrored successor approaches h_0 by a half at least.
    h = 0.0
    for _ in range(_CYCLES):
        h = 0.5 * (h - risen(h, 1.0, fast, slow, exponent))
    return h


@compiled
def _cycled(h: float, fast: float, slow: float, exponent: float) -> float:
    """Return h after a rise over the whole range and a fall back."""
    return -risen(-risen(h, 1.0, fast, slow, exponent), 1.0, fast, slow, exponent)


def steepest_relaxation(skew: float) -> float:
    """Return the largest dh/dz of the term, 2 b/(b + g), from g/b."""
    return 2.0 / (1.0 + skew)
