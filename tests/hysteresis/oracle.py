"""An independent implementation of the paper's operators: slow, plain, without piezod.

Each operator keeps its own two lists of extrema, as (input, output), and follows paper eq. (2) and
eq. (5) literally (the latter with max and min exchanged). Models are sums over such operators.
Tests compare piezod with this module, and `make_vectors` records its outputs.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


@dataclass
class Play:
    """A right (F^r) or left (F^l) play operator with threshold r and its own memory."""

    r: float
    right: bool
    maxima: list[tuple[float, float]] = field(default_factory=lambda: [(1.0, 1.0)])
    minima: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)])
    v: float = 0.0
    w: float = 0.0
    rising: bool = True

    def step(self, value: float) -> float:
        """Return the output for the next input."""
        v = min(max(value, 0.0), 1.0)
        if v == self.v:
            return self.w
        if (v > self.v) != self.rising:
            (self.maxima if self.rising else self.minima).append((self.v, self.w))
            self.rising = not self.rising
        if self.rising:
            while len(self.maxima) > 1 and v >= self.maxima[-1][0]:
                self.maxima.pop()
                self.minima.pop()
        else:
            while len(self.minima) > 1 and v <= self.minima[-1][0]:
                self.maxima.pop()
                self.minima.pop()
        (v_max, w_max), (v_min, w_min) = self.maxima[-1], self.minima[-1]
        chord = w_min + (w_max - w_min) / (v_max - v_min) * (v - v_min)
        if self.right:
            self.w = max((v - self.r) / (1 - self.r), min(chord, self.w))
        else:
            self.w = min(v / (1 - self.r), max(chord, self.w))
        self.v = v
        return self.w

    @property
    def depth(self) -> int:
        """Number of stored extrema, without the two outermost."""
        return len(self.maxima) + len(self.minima) - 2


@dataclass
class Model:
    """x = v + Σ q^r (F^r - v) + Σ q^l (F^l - v), paper eq. (9)."""

    thresholds_right: Sequence[float]
    thresholds_left: Sequence[float]
    q_right: Sequence[float]
    q_left: Sequence[float]

    def __post_init__(self) -> None:
        self.right = [Play(r, right=True) for r in self.thresholds_right]
        self.left = [Play(r, right=False) for r in self.thresholds_left]

    def step(self, v: float) -> float:
        """Return the output for the next input in [0, 1]."""
        x = v
        for q, play in zip(self.q_right, self.right, strict=True):
            x += q * (play.step(v) - v)
        for q, play in zip(self.q_left, self.left, strict=True):
            x += q * (play.step(v) - v)
        return x

    def run(self, values: Iterable[float]) -> Array:
        """Return the outputs for inputs in [0, 1]."""
        return np.array([self.step(float(v)) for v in values])

    @property
    def depth(self) -> int:
        """Number of stored extrema, without the two outermost."""
        return self.right[0].depth


def stops(
    thresholds_left: Sequence[float], thresholds_right: Sequence[float]
) -> Callable[[float], Array]:
    """Return a function from the next x to [E^l, E^r].

    It uses r E^r + (1 - r) F^l = x and r E^l + (1 - r) F^r = x.
    """
    right_plays = [Play(r, right=True) for r in thresholds_left]
    left_plays = [Play(r, right=False) for r in thresholds_right]
    plays = right_plays + left_plays

    def step(x: float) -> Array:
        return np.array([(x - (1 - play.r) * play.step(x)) / play.r for play in plays])

    return step


def inverse(
    thresholds_left: Sequence[float],
    thresholds_right: Sequence[float],
    a_left: Sequence[float],
    a_right: Sequence[float],
    positions: Iterable[float],
) -> Array:
    """Return z = x + Σ a^l (E^l - x) + Σ a^r (E^r - x), paper eq. (16), for x in [0, 1]."""
    step = stops(thresholds_left, thresholds_right)
    weights = np.concatenate((a_left, a_right))
    return np.array([x + weights @ (step(float(x)) - x) for x in positions])


def smallest_slope(model: Model) -> float:
    """Return the smallest slope of x(v) on first loops, where the condition of existence has it.

    First loops are a rise after 1 → 1 - r and a fall after 0 → r, for every threshold r and for the
    whole range. Between the knots x is linear, so differences between them are slopes.
    """
    slopes: list[float] = []
    for r in [*model.thresholds_right, *model.thresholds_left, 1.0]:
        for start, turn in ((1.0, 1.0 - r), (0.0, r)):
            fresh = Model(
                model.thresholds_right, model.thresholds_left, model.q_right, model.q_left
            )
            knots = [0.0, *fresh.thresholds_right, *fresh.thresholds_left, 1.0]
            parts = np.unique([r * knot for knot in knots])
            path = turn + parts if start == 1.0 else turn - parts
            fresh.run([start, turn])
            x = fresh.run(np.clip(path, 0.0, 1.0))
            moves, gains = np.diff(path), np.diff(x)
            wide = np.abs(moves) > 1e-9
            slopes.extend(gains[wide] / moves[wide])
    return float(min(slopes))
