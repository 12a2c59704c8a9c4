"""The paper's identification: least mean squares on the stops of the measured displacement.

The paper calls it recursive least squares; eq 29 is LMS. It needs no model to start from and
follows a stage that changes, but a constant gain forgets: what it leaves fits the last loops seen.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.bank import (
    GAINS,
    advance_plays,
    checked_deadband,
    checked_series,
    new_bank_memory,
    weighted_sum,
)
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    MERGED,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
    relax,
)
from piezod.jit import compiled


@compiled
def _adapt(
    memory: Memory,
    bank: FloatArray,
    weights: FloatArray,
    gain: float,
    deadband: float,
    position: float,
    drive: float,
) -> float:
    """Update the weights with one pair: a ← a + 2γ e (E - x) (eq 29); return e (eq 30)."""
    position = advance_plays(memory, bank, deadband, position)
    error = drive - weighted_sum(memory.now, bank, weights, position)
    if error - error == 0.0:  # a drive that is not finite would spoil the weights for good
        scale = 2.0 * gain * error
        for j in range(weights.size):
            weights[j] += scale * (bank[GAINS, j] * (position - memory.now[j]))
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
    gain: float,
    deadband: float,
    position: float,
    drive: float,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    return _adapt(memory, bank, weights, gain, deadband, position, drive)


@compiled
def _run(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    gain: float,
    deadband: float,
    positions: FloatArray,
    drives: FloatArray,
    errors: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    for k in range(errors.size):
        errors[k] = _adapt(memory, bank, weights, gain, deadband, positions[k], drives[k])


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


class LMSIdentifier:
    """Adapts the weights of an inverse model, pair by pair.

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
        self.weights: FloatArray = np.zeros(bank.shape[1])
        """Weights [a^l, a^r], shape (2 M,); changes in place with each step."""
        if not 0.0 <= gain < largest_stable_gain(bank):
            message = (
                f"an LMS gain of {gain:g} is out of range: with {bank.shape[1] // 2} operators on "
                f"each side it must be from 0 to below {largest_stable_gain(bank):.3g}"
            )
            raise ModelError(message)
        self._memory = new_bank_memory(bank, capacity)
        self._arguments = (*self._memory, bank, self.weights, gain, checked_deadband(deadband))

    def step(self, position: float, drive: float) -> float:
        """Adapt to one pair, both normalised; return the error e_k; may be called in the loop.

        The pair must be contemporaneous: `drive` is what was in force when `position` was taken.
        """
        return _step(*self._arguments, float(position), float(drive))

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,).

        Raises:
            ModelError: If the shapes differ.
        """
        x, v = checked_series(positions), checked_series(drives)
        if x.shape != v.shape:
            message = f"need as many drives as positions, got shapes {v.shape} and {x.shape}"
            raise ModelError(message)
        errors = np.empty_like(x)
        _run(*self._arguments, x, v, errors)
        return errors

    def reset(self) -> None:
        """Forget the past displacement, not the weights."""
        relax(self._memory)

    @property
    def position(self) -> float:
        """Displacement that the operators see, behind the dead-band; may be called in the loop."""
        return self._memory.last[SEEN]

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return int(self._memory.counts[MERGED])


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
