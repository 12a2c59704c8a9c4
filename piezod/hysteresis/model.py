"""The forward model, the analytic inverse of the paper, and the exact inverse."""

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
    """Base of all models: two major branches, a memory, and the steps through the closed form."""

    def __init__(
        self, up: FloatArray, down: FloatArray, *, invert: bool, deadband: float, capacity: int
    ) -> None:
        self._up, self._down, self._invert = up, down, invert
        self._deadband, self._capacity = checked_deadband(deadband), capacity
        self._memory = new_loop_memory(capacity)
        # Collected once: a step unpacks this tuple and looks up no attributes.
        self._arguments = (*self._memory, up, down, invert, self._deadband)

    def step(self, value: float) -> float:
        """Return the output for the next input, both normalised. Real-time safe.

        An input outside [0, 1] is clamped, and NaN repeats the last input. The step allocates no
        array and raises nothing.
        """
        return closed_form.step(*self._arguments, float(value))

    def run(self, values: npt.ArrayLike) -> FloatArray:
        """Return the outputs, shape (n,), for inputs of shape (n,), from the present state on.

        Inputs are clamped to [0, 1], as in `step`.

        Raises:
            ModelError: If the inputs have another number of dimensions.
        """
        inputs = checked_series(values)
        outputs = np.empty_like(inputs)
        closed_form.run(*self._arguments, inputs, outputs)
        return outputs

    def reset(self) -> None:
        """Return to the relaxed state: input 0, output 0, no stored extrema."""
        relax_loops(self._memory)

    def state(self) -> Memory:
        """Return a copy of the state, for `restore` of a model of the same capacity."""
        return copy_memory(self._memory)

    def restore(self, state: Memory) -> None:
        """Continue from a saved state.

        Raises:
            ModelError: If a model of another capacity saved it.
        """
        assign_memory(self._memory, state)

    def copy(self) -> Self:
        """Return an independent model in the same state."""
        # The constructor would compute the branches anew; only the memory has to be copied.
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._memory = copy_memory(self._memory)
        twin._arguments = (*twin._memory, self._up, self._down, self._invert, self._deadband)
        return twin

    @property
    def depth(self) -> int:
        """Number of stored extrema, without the two outermost."""
        return depth(self._memory)

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])

    @property
    def smallest_slope(self) -> float:
        """Smallest slope of the map anywhere; for an exact inverse, of the map that it inverts."""
        return closed_form.smallest_slope(self._up, self._down)


class ExactInverse(_LoopModel):
    """Inverse of a model that is exact on every loop; made by the model's `exact_inverse`."""


class _InvertibleModel(_LoopModel):
    """Model whose map can be inverted exactly, if the condition of existence holds."""

    def exact_inverse(self) -> ExactInverse:
        """Return the inverse that is exact on every loop, in its relaxed state.

        Raises:
            ModelError: If the model is not invertible from every reachable state.
        """
        slope = self.smallest_slope  # over all loops, not only over the major branches
        if slope <= 0.0:
            # slope - 1 is linear in the weights, so a common factor moves it in proportion.
            factor = (1.0 - LEAST_SLOPE) / (1.0 - slope)
            message = (
                f"no inverse exists: the smallest slope of the model is {slope:.4g}, it must be "
                f"positive on every loop; scale the weights by {factor:.3g} for a smallest slope "
                f"of {LEAST_SLOPE:g}"
            )
            raise ModelError(message)
        return ExactInverse(
            self._up, self._down, invert=True, deadband=self._deadband, capacity=self._capacity
        )


class MPIModel(_InvertibleModel):
    """Modified Prandtl-Ishlinskii model x = H[v], normalised to [0, 1], paper eq. (9).

    Its rising major branch is paper eq. (17). Paper eq. (6), eq. (7) and eq. (8) state the same
    model with integrals.

    Args:
        thresholds: (M,) thresholds of the right plays, strictly increasing in (0, 1).
        right_weights: (M,) weights q^r.
        left_weights: (M,) weights q^l; (N,) if `left_thresholds` is given.
        left_thresholds: (N,) thresholds of the left plays; by default those of the right plays.
        deadband: Width of the backlash before the memory, in units of the range; 0 for none.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If thresholds do not increase inside (0, 1), or weights do not match them.
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
            invert=False,
            deadband=deadband,
            capacity=capacity,
        )

    def inverse(self) -> "InverseMPI":
        """Return the analytic inverse of the paper, eq. (19) to eq. (24), corrected.

        It is exact on the major loop and approximate on loops inside it.

        Raises:
            ModelError: If a slope of a major branch is not positive, so that no inverse exists.
        """
        # The rising branch belongs to the right plays, and its inverse to the left stops.
        left_stop_thresholds, left_stop_weights = _inverse_stops(self._up, "rising")
        right_stop_thresholds, right_stop_weights = _inverse_stops(self._down, "falling")
        return InverseMPI(
            right_stop_thresholds,
            left_stop_thresholds,
            right_stop_weights,
            left_stop_weights,
            deadband=self._deadband,
            capacity=self._capacity,
        )


class InverseMPI(_InvertibleModel):
    """Inverse model z = H⁻¹[x] as a sum of stop operators, paper eq. (16).

    Because r E^r + (1 - r) F^l = x, it has the form of the forward model, with play weights -a (1 -
    r') / r'. The right stop belongs to the left play, and the left stop to the right play. The
    rising major branch is paper eq. (18). Paper eq. (14) and eq. (15) state the same model with
    integrals. The exact inverse of this model is the forward model that it inverts on every loop.

    Args:
        right_stop_thresholds: (M,) thresholds r' of the right stops.
        left_stop_thresholds: (N,) thresholds r' of the left stops.
        right_stop_weights: (M,) weights a^r.
        left_stop_weights: (N,) weights a^l.
        deadband: Width of the backlash before the memory, in units of the range; 0 for none.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If thresholds do not increase inside (0, 1), or weights do not match them.
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
        # Left stops belong to right plays, which set the rising branch; right stops to left plays.
        super().__init__(
            branch(
                self.left_stop_thresholds,
                -self.left_stop_weights * stop_gains(self.left_stop_thresholds),
            ),
            branch(
                self.right_stop_thresholds,
                -self.right_stop_weights * stop_gains(self.right_stop_thresholds),
            ),
            invert=False,
            deadband=deadband,
            capacity=capacity,
        )


def _inverse_stops(table: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
    """Return thresholds and weights of the stops that invert one major branch.

    The thresholds are r'_J = φ(r_J), paper eq. (19), corrected. The slopes obey ψ'_J = 1 / φ'_J,
    paper eq. (24). With ψ'_J of paper eq. (23), corrected, the differences of neighbouring slopes
    give the closed form a_J = r'_J (1 / φ'_J - 1 / φ'_{J+1}).
    """
    # The last column repeats the last slope; the first and the last height are 0 and 1.
    slopes, thresholds = table[SLOPES, :-1], table[HEIGHTS, 1:-1]
    if not bool(np.all(slopes > 0.0)):
        message = (
            f"no inverse exists: the {name} branch has a slope of {float(np.min(slopes)):.4g} "
            f"between thresholds {int(np.argmin(slopes))} and {int(np.argmin(slopes)) + 1}, "
            "but every slope must be positive"
        )
        raise ModelError(message)
    return thresholds.copy(), thresholds * (1.0 / slopes[:-1] - 1.0 / slopes[1:])


def _checked_weights(weights: npt.ArrayLike, thresholds: FloatArray) -> FloatArray:
    array = np.array(weights, dtype=np.float64, ndmin=1)
    if array.shape != thresholds.shape or not bool(np.all(np.isfinite(array))):
        message = f"need {thresholds.size} finite weights, one per threshold, got {array}"
        raise ModelError(message)
    return array
