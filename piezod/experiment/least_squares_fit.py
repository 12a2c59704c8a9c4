"""Least squares over a whole record: weights, and with them creep, where that is asked for.

The drive that the model predicts is linear in its weights. It is not in what creeps, so that the
fit is repeated around its last result (Gauss and Newton), each time as one constrained problem.

With y the displacement without creep, normalised so that the largest drive belongs to y = 1:

    y = (1 + stretch) (x - creep) - offset

The offset is what the stage has drifted by since it was zeroed, in the run-in.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from piezod.errors import DataError
from piezod.experiment.creep_law import NO_CREEP, logarithmic
from piezod.experiment.stage_model import without_creep
from piezod.hysteresis import stop_regressors
from piezod.hysteresis.least_squares import solve_constrained
from piezod.hysteresis.memory import FloatArray

RIDGE = 1e-6
"""Penalty on the weights, relative to the mean power of their regressors."""
_ROUNDS = 8
_STEP = 1e-4  # for differences
_SETTLED = 1e-6


class Slow(NamedTuple):
    """How the measured displacement becomes that of the hysteresis, y.

    Attributes:
        creep: Weight of each lag.
        offset: Drift, in units of the range.
        stretch: Growth of the range's unit.
    """

    creep: float = 0.0
    offset: float = 0.0
    stretch: float = 0.0


@dataclass(frozen=True)
class Series:
    """A record, normalised and aligned.

    Attributes:
        positions: (n,) displacement, in units of its range.
        drives: (n,) voltage that it answers to, in units of its range.
        period_s: Time from sample to sample, in s.
        from_rest: Whether the stage had rested where it begins.
        counted: (n,) which samples count; the others only carry the memory on.
    """

    positions: FloatArray
    drives: FloatArray
    period_s: float
    from_rest: bool
    counted: np.ndarray[tuple[int], np.dtype[np.bool_]]

    def quick(self, slow: Slow) -> FloatArray:
        """Return y, shape (n,)."""
        x = (1.0 + slow.stretch) * self.positions - slow.offset
        law = logarithmic(slow.creep) if slow.creep else NO_CREEP
        return without_creep(x, law, self.period_s, from_rest=self.from_rest)


@dataclass(frozen=True)
class Linearised:
    """The problem as it is around its solution: linear in everything that is looked for.

    Attributes:
        bank: (2, 2 M) of the stops.
        regressors: (n, 2 M + E) of the weights and of what is slow.
        target: (n,) what they have to add up to.
        counted: (n,) which rows count.
        parameters: (2 M + E,) the solution.
    """

    bank: FloatArray
    regressors: FloatArray
    target: FloatArray
    counted: np.ndarray[tuple[int], np.dtype[np.bool_]]
    parameters: FloatArray

    @property
    def misses(self) -> FloatArray:
        """Predicted minus actual drive in units of its range, shape (n,)."""
        return self.regressors @ self.parameters - self.target

    def solved(self, rows: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> FloatArray:
        """Return the parameters that fit some of the rows best, shape (2 M + E,)."""
        return _solve(self.bank, self.regressors[rows], self.target[rows])


class LeastSquaresFit(NamedTuple):
    """What was found.

    Attributes:
        weights: (2 M,) weights [a^l, a^r].
        slow: What creeps and drifts; nothing where that was not asked for.
        linearised: The problem around this solution.
    """

    weights: FloatArray
    slow: Slow
    linearised: Linearised


def fit_least_squares(
    bank: FloatArray, series: Series, *, creep: bool, deadband: float = 0.0
) -> LeastSquaresFit:
    """Fit weights, and creep if asked for.

    Args:
        bank: (2, 2 M) of the stops.
        series: The record.
        creep: Whether creep, offset and stretch are fitted too.
        deadband: Width of the backlash before the memory, in units of the range.

    Raises:
        DataError: If the search for the creep does not settle.
    """
    n_weights = bank.shape[1]
    slow = Slow()
    y = series.quick(slow)
    regressors = _stops(bank, y, deadband)
    target = series.drives - np.clip(y, 0.0, 1.0)
    weights = _solve(bank, regressors[series.counted], target[series.counted])
    if not creep:
        return LeastSquaresFit(
            weights, slow, Linearised(bank, regressors, target, series.counted, weights)
        )
    for _ in range(_ROUNDS):
        linearised = _linearise(bank, series, weights, slow, deadband)
        before, slow = slow, Slow(*linearised.parameters[n_weights:])
        weights = linearised.parameters[:n_weights]
        if max(abs(new - old) for new, old in zip(slow, before, strict=True)) < _SETTLED:
            break
    if not (abs(slow.stretch) < 0.5 and abs(slow.offset) < 0.5):
        raise DataError(
            f"no creep could be fitted: the search went to a stretch of {slow.stretch:.2g} and an "
            f"offset of {slow.offset:.2g} of the range; fit without creep, or record for longer"
        )
    return LeastSquaresFit(weights, slow, linearised)


def _linearise(
    bank: FloatArray, series: Series, weights: FloatArray, slow: Slow, deadband: float
) -> Linearised:
    y = series.quick(slow)
    stops = _stops(bank, y, deadband)
    drives = np.clip(y, 0.0, 1.0) + stops @ weights
    columns = []
    for i in range(len(slow)):
        moved = series.quick(Slow(*(value + _STEP * (i == j) for j, value in enumerate(slow))))
        there = np.clip(moved, 0.0, 1.0) + _stops(bank, moved, deadband) @ weights
        columns.append((there - drives) / _STEP)
    slow_regressors = np.stack(columns, axis=1)
    regressors = np.hstack([stops, slow_regressors])
    target = series.drives - np.clip(y, 0.0, 1.0) + slow_regressors @ np.array(slow)
    counted = series.counted
    parameters = _solve(bank, regressors[counted], target[counted])
    return Linearised(bank, regressors, target, counted, parameters)


def _stops(bank: FloatArray, y: FloatArray, deadband: float) -> FloatArray:
    return stop_regressors(bank, np.clip(y, 0.0, 1.0), deadband)


def _solve(bank: FloatArray, regressors: FloatArray, target: FloatArray) -> FloatArray:
    """Solve one linear problem; creep, where it is looked for, is not negative."""
    n_weights = bank.shape[1]
    gram = regressors.T @ regressors
    powers = np.diag(gram)
    penalties = np.full(powers.size, RIDGE * float(np.mean(powers[:n_weights])))
    if penalties[0] == 0.0:
        raise DataError("the displacement does not move: there is nothing to identify from")
    penalties[n_weights:] = 1e-9 * powers[n_weights:]
    nonnegative = (n_weights,) if powers.size > n_weights else ()
    return solve_constrained(
        gram + np.diag(penalties), regressors.T @ target, bank, nonnegative=nonnegative
    )
