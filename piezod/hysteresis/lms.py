"""Least mean squares on the stops of the measured displacement: the paper's identification.

The paper calls it recursive least squares; eq 29 is LMS. It needs no model to start from and
follows a stage that changes, but a constant gain forgets: what it leaves fits the last loops seen.
"""

from dataclasses import dataclass

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.bank import GAINS, THRESHOLDS
from piezod.hysteresis.learner import (
    OFFSET,
    POSITION,
    SCALE,
    Learner,
    is_finite,
    keep_weights_invertible,
    observe,
    own_prediction,
    taught,
)
from piezod.hysteresis.memory import DEFAULT_CAPACITY, FloatArray, IntArray, Memory
from piezod.hysteresis.online import OnlineIdentifier
from piezod.jit import compiled


@compiled
def _power(memory: Memory, bank: FloatArray, position: float) -> float:
    """Return ‖E - x‖²."""
    power = 0.0
    for j in range(memory.now.size):
        power += (bank[GAINS, j] * (position - memory.now[j])) ** 2
    return power


@compiled
def _adapt(
    memory: Memory,
    learner: Learner,
    gain: float,
    floor: float,
    reach: float,
    deadband: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    """Update the weights with one pair: a ← a + 2γ e (E - x) (eq 29); return e (eq 30).

    With a floor above 0 it is normalised: a ← a + μ e (E - x) / (floor + ‖E - x‖²).
    """
    if not is_finite(position):
        return np.nan
    bank, weights, scalars = learner.bank, learner.weights, learner.scalars
    seen = observe(memory, learner, deadband, position)
    if floor == 0.0:  # in the paper, what lies outside the range does not count
        scalars[POSITION] = (seen + scalars[OFFSET]) / (1.0 + scalars[SCALE])
    error = drive - own_prediction(memory, learner)
    if learn and is_finite(error):
        rate = 2.0 * gain if floor == 0.0 else gain / (floor + _power(memory, bank, seen))
        stride = rate * taught(error)
        for j in range(weights.size):
            weights[j] += stride * (bank[GAINS, j] * (seen - memory.now[j]))
        keep_weights_invertible(learner, reach * abs(stride))
    return error


@compiled
def _step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    scalars: FloatArray,
    slopes: FloatArray,
    cells: FloatArray,
    gain: float,
    floor: float,
    reach: float,
    deadband: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    return _adapt(memory, learner, gain, floor, reach, deadband, position, drive, learn)


@compiled
def _run(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    scalars: FloatArray,
    slopes: FloatArray,
    cells: FloatArray,
    gain: float,
    floor: float,
    reach: float,
    deadband: float,
    positions: FloatArray,
    drives: FloatArray,
    errors: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, scalars, slopes, cells)
    for k in range(errors.size):
        position, drive = positions[k], drives[k]
        errors[k] = _adapt(memory, learner, gain, floor, reach, deadband, position, drive, True)


def largest_stable_gain(bank: FloatArray) -> float:
    """Return the gain γ below which LMS on a bank cannot diverge, whatever the displacement.

    The update is stable while 2γ ‖E - x‖² < 2. A right play lies below x by at most x and by at
    most (1 - x) r / (1 - r), a left play above it by the mirrored amounts; ‖E - x‖² is bounded by
    the largest sum of their squares over x. For the paper's 19 thresholds a side that is 5.9.
    """
    left, right = np.split(bank, 2, axis=1)
    x = np.linspace(0.0, 1.0, 1001)[:, np.newaxis]
    below = np.minimum(left[GAINS] * x, 1.0 - x)
    above = np.minimum(x, right[GAINS] * (1.0 - x))
    return 1.0 / float(np.max(np.sum(below**2, axis=1) + np.sum(above**2, axis=1)))


def _reach(bank: FloatArray, deadband: float) -> float:
    """Return by how much adding E - x to the weights moves a slope of either side, at most.

    A slope is 1 plus some weights times g less the others, and |E - x| is at most 1 - r, or g δ / 2
    more behind a dead-band of width δ.
    """
    largest = 1.0 - bank[THRESHOLDS] + 0.5 * deadband * bank[GAINS]
    return float(np.sum(np.maximum(bank[GAINS], 1.0) * largest))


class GradientIdentifier(OnlineIdentifier):
    """Moves the weights along the regressor of each pair; a floor above 0 makes it normalised."""

    def __init__(
        self, bank: FloatArray, gain: float, floor: float, deadband: float, capacity: int
    ) -> None:
        super().__init__(bank, np.zeros(bank.shape[1]), deadband, capacity)
        self._arguments = (
            *self._memory,
            *self._learner,
            gain,
            floor,
            _reach(bank, deadband),
            self._deadband,
        )

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, as in `OnlineIdentifier`; may be called in the loop."""
        return _step(*self._arguments, float(position), float(drive), learn)

    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        _run(*self._arguments, positions, drives, errors)


class LMSIdentifier(GradientIdentifier):
    """The paper's identifier (eqs 29, 30): weights from zero on, a constant gain, no more.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        gain: γ, from 0 to below `largest_stable_gain`.
        deadband: Width of the backlash before the memory, in units of the range; above the noise.
        capacity: Extrema remembered on each side.

    Raises:
        ModelError: If the gain is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        *,
        gain: float = 0.1,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        if not 0.0 <= gain < largest_stable_gain(bank):
            message = (
                f"an LMS gain of {gain:g} is out of range: with {bank.shape[1] // 2} operators on "
                f"each side it must be from 0 to below {largest_stable_gain(bank):.3g}"
            )
            raise ModelError(message)
        super().__init__(bank, gain, 0.0, deadband, capacity)


@dataclass
class Convergence:
    """The paper's criterion, |e_k - e_{k-1}| below a tolerance, asked of a whole window.

    One sample proves nothing: the difference is small by chance. Nor do samples that do not move:
    leave them out.
    """

    tolerance: float
    window: int
    _quiet: int = 0
    _previous: float = np.inf

    def update(self, error: float) -> bool:
        """Take the next error; return whether the last `window` differences were all small."""
        small = abs(error - self._previous) < self.tolerance
        self._quiet = self._quiet + 1 if small else 0
        self._previous = error
        return self._quiet >= self.window
