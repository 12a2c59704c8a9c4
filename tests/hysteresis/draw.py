"""Thresholds, models of many kinds, inputs with tiny loops and plateaus; a swing that varies."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.hysteresis import MPIModel
from tests.hysteresis import oracle

UNIT = st.floats(0, 1)
SMALLEST_CELL = 0.01

Sides = tuple[list[float], list[float], list[float], list[float]]
"""Thresholds right and left, weights q right and left."""


@st.composite
def thresholds(draw: st.DrawFn, *, most: int = 6) -> list[float]:
    """Draw thresholds in (0, 1), at least `SMALLEST_CELL` apart and from either end."""
    count = draw(st.integers(1, most))
    parts = np.array(draw(st.lists(UNIT, min_size=count + 1, max_size=count + 1))) + 1e-3
    cells = SMALLEST_CELL + (1 - (count + 1) * SMALLEST_CELL) * parts / parts.sum()
    return [float(r) for r in np.cumsum(cells)[:-1]]


@st.composite
def weights(draw: st.DrawFn, count: int) -> list[float]:
    """Draw weights of either sign."""
    return draw(st.lists(st.floats(-0.6, 0.6), min_size=count, max_size=count))


@st.composite
def any_sides(draw: st.DrawFn) -> Sides:
    """Draw a model that need not have an inverse; each side has thresholds of its own."""
    right, left = draw(thresholds()), draw(thresholds())
    return right, left, draw(weights(len(right))), draw(weights(len(left)))


@st.composite
def side_with_slopes(draw: st.DrawFn, least: float) -> tuple[list[float], list[float]]:
    """Draw thresholds and weights of a side whose major branch has slopes of at least `least`."""
    r = draw(thresholds())
    cells = np.diff([0.0, *r, 1.0])
    parts = np.array(draw(st.lists(UNIT, min_size=cells.size, max_size=cells.size))) + 1e-3
    slopes = least + (1 - least) * parts / (parts @ cells)
    return r, [float(q) for q in (1 - np.array(r)) * np.diff(slopes)]


@st.composite
def sides_with_slopes(draw: st.DrawFn, least: float) -> Sides:
    """Draw both sides with slopes of at least `least` on both major branches."""
    right, q_right = draw(side_with_slopes(least))
    left, q_left = draw(side_with_slopes(least))
    return right, left, q_right, q_left


def inputs(*, least: int = 1, most: int = 40) -> st.SearchStrategy[NDArray[np.float64]]:
    """Draw turning points in [0, 1], including the ends, repeated values and loops of 1e-9."""
    moves = st.tuples(st.sampled_from(["to", "end", "stay", "back", "tremble"]), UNIT)
    return st.lists(moves, min_size=least, max_size=most).map(_path)


def _path(moves: list[tuple[str, float]]) -> NDArray[np.float64]:
    points = [0.0]
    for kind, part in moves:
        target = {
            "to": part,
            "end": round(part),
            "stay": points[-1],
            "back": points[int(part * (len(points) - 1))],
            "tremble": points[-1] + 1e-9 * (2 * part - 1),
        }[kind]
        points.append(min(max(float(target), 0.0), 1.0))
    return np.array(points[1:])


def model(sides: Sides, *, deadband: float = 0.0, capacity: int = 64) -> MPIModel:
    """Return the model of these sides, with a memory that is large enough for all drawn inputs."""
    right, left, q_right, q_left = sides
    return MPIModel(
        right, q_right, q_left, left_thresholds=left, deadband=deadband, capacity=capacity
    )


def slow_model(sides: Sides) -> oracle.Model:
    """Return the same model, made of the oracle's operators."""
    return oracle.Model(*sides)


def dense(points: Sequence[float] | NDArray[np.float64], between: int) -> NDArray[np.float64]:
    """Return a path through turning points with some samples between them."""
    pieces = [np.linspace(a, b, between, endpoint=False) for a, b in pairwise(points)]
    return np.concatenate([*pieces, [points[-1]]])


def command(seconds: float, amplitude: float = 0.5, beat: float = 0.07) -> NDArray[np.float64]:
    """Return a sine of 0.5 Hz at 1 kHz with a varying amplitude."""
    t = np.arange(0, seconds, 1e-3)
    return 0.5 - amplitude * np.cos(np.pi * t) * np.cos(beat * np.pi * t)
