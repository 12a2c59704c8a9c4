"""Base class of all identifiers that learn pair by pair."""

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.bank import checked_deadband, checked_series, new_bank_memory
from piezod.hysteresis.learner import (
    OFFSET,
    POSITION,
    SCALE,
    SCALE_LIMIT,
    SLOPE_MARGIN,
    Learner,
    new_learner,
    prediction,
)
from piezod.hysteresis.memory import MERGED, SEEN, FloatArray, IntArray, Memory, relax
from piezod.hysteresis.slopes import projected
from piezod.jit import compiled


def checked_pairs(positions: npt.ArrayLike, drives: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return a record of pairs, paper eq. (25) and eq. (26), as arrays of shape (n,) each.

    Raises:
        ModelError: If the shapes differ.
    """
    x, v = checked_series(positions), checked_series(drives)
    if x.shape != v.shape:
        message = f"need as many drives as positions, got shapes {v.shape} and {x.shape}"
        raise ModelError(message)
    return x, v


# The fields of the tuples are passed one by one, see decision 3.
@compiled
def _predict(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    own: FloatArray,
    scalars: FloatArray,
    slopes: FloatArray,
    widths: FloatArray,
    weights: FloatArray,
    offset: float,
    scale: float,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, own, scalars, slopes, widths)
    return prediction(memory, learner, weights, offset, scale)


class OnlineIdentifier(ABC):
    """Adaptive weights of an inverse model, with a memory of their own.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) initial weights [a^l, a^r].
        deadband: Width of the backlash before the memory, in units of the range; larger than the
            noise.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If the weights are not 2 M finite numbers, or another argument is out of range.
    """

    def __init__(
        self, bank: FloatArray, weights: npt.ArrayLike, deadband: float, capacity: int
    ) -> None:
        self._learner = new_learner(bank)
        self._memory = new_bank_memory(bank, capacity)
        self._deadband = checked_deadband(deadband)
        # Not self.adopt: a subclass extends it and its own attributes do not exist yet.
        OnlineIdentifier.adopt(self, weights)

    @abstractmethod
    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, both values normalised; return the error. Real-time safe.

        Args:
            position: Displacement; if it is not finite, the memory stays.
            drive: Drive in force when `position` was sampled.
            learn: Whether to learn from the pair; the memory advances in either case.

        Returns:
            Drive minus its prediction by the model before this step. It is not finite if the pair
            is not; such a pair teaches nothing.
        """

    @abstractmethod
    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        """Adapt to pairs, shape (n,) each; write the errors, shape (n,)."""

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,).

        Raises:
            ModelError: If the shapes differ.
        """
        x, v = checked_pairs(positions, drives)
        errors = np.empty_like(x)
        self._run(x, v, errors)
        return errors

    def predict(self, weights: FloatArray, offset: float, scale: float) -> float:
        """Return the drive that another model predicts for the last displacement. Real-time safe.

        Args:
            weights: (2 M,) weights [a^l, a^r].
            offset: Offset of the displacement.
            scale: Scale of the displacement.
        """
        return _predict(*self._memory, *self._learner, weights, float(offset), float(scale))

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, and restart their uncertainty.

        Weights without an inverse are projected onto the nearest weights with an inverse.

        Raises:
            ModelError: If they are not 2 M finite weights, a finite offset and a scale within
                `SCALE_LIMIT`.
        """
        array = np.asarray(weights, dtype=np.float64)
        if array.shape != self.weights.shape or not np.all(np.isfinite(array + offset)):
            message = f"need {self.weights.size} finite weights and a finite offset, got {array}"
            raise ModelError(message)
        if not abs(scale) <= SCALE_LIMIT:  # refuses NaN too
            message = f"a scale must be from {-SCALE_LIMIT:g} to {SCALE_LIMIT:g}, got {scale:g}"
            raise ModelError(message)
        # In place: the arguments of the compiled step refer to this array.
        self.weights[:] = projected(self._learner.bank, array)
        scalars = self._learner.scalars
        # A margin of 0 makes the next step check the condition of existence again.
        scalars[OFFSET], scalars[SCALE], scalars[SLOPE_MARGIN] = offset, scale, 0.0

    def reset(self) -> None:
        """Clear the hysteresis memory; the learned model stays."""
        relax(self._memory)
        # The displacement at which the operator input is 0, as in the relaxed memory.
        self._learner.scalars[POSITION] = self.offset / (1.0 + self.scale)

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place.

        Use `adopt` to set them.
        """
        return self._learner.weights

    @property
    def offset(self) -> float:
        """Offset of the displacement against the operator input, in units of the range."""
        return float(self._learner.scalars[OFFSET])

    @property
    def scale(self) -> float:
        """Relative gain of the operator input over the displacement: y = (1 + scale) x - offset."""
        return float(self._learner.scalars[SCALE])

    @property
    def position(self) -> float:
        """Displacement at the input of the operators, after the dead-band. Real-time safe."""
        return float(self._memory.last[SEEN])

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])
