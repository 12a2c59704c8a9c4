"""The forward model, its analytic inverse (the paper's) and its exact inverse."""

from typing import Self

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis import closed_form
from piezod.hysteresis.bank import (
    checked_deadband,
    checked_series,
    checked_thresholds,
    stop_gains,
)
from piezod.hysteresis.closed_form import HEIGHTS, SLOPES, branch, new_loop_memory, relax_loops
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    MERGED,
    FloatArray,
    Memory,
    assign_memory,
    copy_memory,
    depth,
)
from piezod.hysteresis.slopes import LEAST_SLOPE


class _LoopModel:
    """What the models share: two branches, a memory, and the state that goes with it."""

    def __init__(
        self, up: FloatArray, down: FloatArray, *, solve: bool, deadband: float, capacity: int
    ) -> None:
        self._up, self._down, self._solve = up, down, solve
        self._deadband, self._capacity = checked_deadband(deadband), capacity
        self._memory = new_loop_memory(capacity)
        self._arguments = (*self._memory, up, down, solve, self._deadband)

    def step(self, value: float) -> float:
        """Return the output for the next input; may be called in the loop.

        Inputs are normalised; outside [0, 1] they are clamped, and one that is not a number counts
        as no move. Allocates no array and raises nothing.
        """
        return closed_form.step(*self._arguments, float(value))

    def run(self, values: npt.ArrayLike) -> FloatArray:
        """Return the outputs, shape (n,), for inputs of shape (n,), going on from the state.

        Inputs are clamped to [0, 1], as in `step`.

        Raises:
            ModelError: If the inputs are of another shape.
        """
        inputs = checked_series(values)
        outputs = np.empty_like(inputs)
        closed_form.run(*self._arguments, inputs, outputs)
        return outputs

    def reset(self) -> None:
        """Return to the relaxed state: input 0, output 0, nothing remembered."""
        relax_loops(self._memory)

    def state(self) -> Memory:
        """Return a copy of the state, to be given to `restore` of a model of the same capacity."""
        return copy_memory(self._memory)

    def restore(self, state: Memory) -> None:
        """Go on from a state that was saved.

        Raises:
            ModelError: If it was saved by a model of another capacity.
        """
        assign_memory(self._memory, state)

    def copy(self) -> Self:
        """Return an independent model in the same state."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._memory = copy_memory(self._memory)
        twin._arguments = (*twin._memory, self._up, self._down, self._solve, self._deadband)
        return twin

    @property
    def depth(self) -> int:
        """Number of extrema remembered beside the two outermost."""
        return depth(self._memory)

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return int(self._memory.counts[MERGED])

    @property
    def smallest_slope(self) -> float:
        """The smallest slope anywhere of the map that is (for an exact inverse: was) stepped."""
        return closed_form.smallest_slope(self._up, self._down)


class ExactInverse(_LoopModel):
    """Inverse of a model that is exact on every loop; made by the `exact_inverse` of that model."""


class _Invertible(_LoopModel):
    """A model whose inverse can be stepped, where it has one."""

    def exact_inverse(self) -> ExactInverse:
        """Return the inverse that is exact on every loop, in its relaxed state.

        Raises:
            ModelError: If the model is not invertible from every state it can reach.
        """
        slope = self.smallest_slope
        if slope <= 0.0:
            enough = (1.0 - LEAST_SLOPE) / (
                1.0 - slope
            )  # slopes are 1 + something linear in weights
            message = (
                f"no inverse exists: the smallest slope of the model is {slope:.4g}, it must be "
                f"positive on every loop; weights {enough:.3g} times as large would leave "
                f"{LEAST_SLOPE:g}"
            )
            raise ModelError(message)
        return ExactInverse(
            self._up, self._down, solve=True, deadband=self._deadband, capacity=self._capacity
        )


class MPIModel(_Invertible):
    """Modified Prandtl-Ishlinskii model x = H[v], normalised to [0, 1] (eq 9).

    Args:
        thresholds: (M,) thresholds of the right plays, strictly increasing in (0, 1).
        right_weights: (M,) weights q^r.
        left_weights: (M,) weights q^l; (N,) where `left_thresholds` is given.
        left_thresholds: (N,) thresholds of the left plays; those of the right ones by default.
        deadband: Width of the backlash before the memory, in units of the range; 0 for none.
        capacity: Extrema remembered on each side.

    Raises:
        ModelError: If thresholds do not increase inside (0, 1), or weights do not fit them.
    """

    def __init__(
        self,
        thresholds: npt.ArrayLike,
        right_weights: npt.ArrayLike,
        left_weights: npt.ArrayLike,
        *,
        left_thresholds: npt.ArrayLike | None = None,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        self.right_thresholds = checked_thresholds(thresholds)
        self.left_thresholds = checked_thresholds(
            thresholds if left_thresholds is None else left_thresholds
        )
        self.right_weights = _checked_weights(right_weights, self.right_thresholds)
        self.left_weights = _checked_weights(left_weights, self.left_thresholds)
        super().__init__(
            branch(self.right_thresholds, self.right_weights),
            branch(self.left_thresholds, self.left_weights),
            solve=False,
            deadband=deadband,
            capacity=capacity,
        )

    def inverse(self) -> "InverseMPI":
        """Return the paper's analytic inverse, in closed form (eqs 17 to 24, corrected).

        It is exact on the major loop and approximate on loops inside it.

        Raises:
            ModelError: If a slope of a major branch is not positive, so that no inverse exists.
        """
        left_stop_thresholds, left_stop_weights = _stops(self._up, "rising")
        right_stop_thresholds, right_stop_weights = _stops(self._down, "falling")
        return InverseMPI(
            right_stop_thresholds,
            left_stop_thresholds,
            right_stop_weights,
            left_stop_weights,
            deadband=self._deadband,
            capacity=self._capacity,
        )


class InverseMPI(_Invertible):
    """Inverse model z = H⁻¹[x] as a sum of stop operators (eq 16).

    By `r E^r + (1 - r) F^l = x` it has the form of the forward model, with play weights
    -a (1 - r') / r'; the right stop goes with the left play, and conversely. The exact inverse of
    this model is the forward model that it undoes on every loop.

    Args:
        right_stop_thresholds: (M,) thresholds r' of the right stops.
        left_stop_thresholds: (N,) thresholds r' of the left stops.
        right_stop_weights: (M,) weights a^r.
        left_stop_weights: (N,) weights a^l.
        deadband: Width of the backlash before the memory, in units of the range; 0 for none.
        capacity: Extrema remembered on each side.

    Raises:
        ModelError: If thresholds do not increase inside (0, 1), or weights do not fit them.
    """

    def __init__(
        self,
        right_stop_thresholds: npt.ArrayLike,
        left_stop_thresholds: npt.ArrayLike,
        right_stop_weights: npt.ArrayLike,
        left_stop_weights: npt.ArrayLike,
        *,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        self.right_stop_thresholds = checked_thresholds(right_stop_thresholds)
        self.left_stop_thresholds = checked_thresholds(left_stop_thresholds)
        self.right_stop_weights = _checked_weights(right_stop_weights, self.right_stop_thresholds)
        self.left_stop_weights = _checked_weights(left_stop_weights, self.left_stop_thresholds)
        super().__init__(
            branch(
                self.left_stop_thresholds,
                -self.left_stop_weights * stop_gains(self.left_stop_thresholds),
            ),
            branch(
                self.right_stop_thresholds,
                -self.right_stop_weights * stop_gains(self.right_stop_thresholds),
            ),
            solve=False,
            deadband=deadband,
            capacity=capacity,
        )


def _stops(table: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
    """Return thresholds and weights of the stops that undo one major branch.

    r'_J = φ(r_J), and ψ'_J = 1 / φ'_J telescopes to a_J = r'_J (1 / φ'_J - 1 / φ'_{J+1}).
    """
    slopes, thresholds = table[SLOPES, :-1], table[HEIGHTS, 1:-1]
    if not bool(np.all(slopes > 0.0)):
        message = (
            f"no inverse exists: the {name} branch has a slope of {float(np.min(slopes)):.4g} "
            f"between thresholds {int(np.argmin(slopes))} and {int(np.argmin(slopes)) + 1}, "
            "every slope must be positive"
        )
        raise ModelError(message)
    return thresholds.copy(), thresholds * (1.0 / slopes[:-1] - 1.0 / slopes[1:])


def _checked_weights(weights: npt.ArrayLike, thresholds: FloatArray) -> FloatArray:
    array = np.array(weights, dtype=np.float64, ndmin=1)
    if array.shape != thresholds.shape or not bool(np.all(np.isfinite(array))):
        message = f"need {thresholds.size} finite weights, one for each threshold, got {array}"
        raise ModelError(message)
    return array
