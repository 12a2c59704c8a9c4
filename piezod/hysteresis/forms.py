"""Forms of a model of hysteresis: the part that is fixed while the weights are identified.

Each method gets the weights, so that one form serves the identified and the learned model. All
quantities are normalised. A record starts in the relaxed state, and contains no creep.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from piezod.hysteresis.bank import new_bank
from piezod.hysteresis.least_squares import stop_regressors
from piezod.hysteresis.loop_drives import LoopDrives, StopLoop
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.model import InverseMPI
from piezod.hysteresis.past import Past, StopPast
from piezod.hysteresis.slopes import projected
from piezod.hysteresis.thresholds import even_thresholds


class SteppedStage(Protocol):
    """A stage without creep that is driven step by step."""

    def step(self, drive: float, /) -> float:
        """Return the displacement for the next drive in [0, 1]. Real-time safe."""


class ModelForm(Protocol):
    """The fixed part of a model of hysteresis."""

    @property
    def size(self) -> int:
        """Number of weights."""

    @property
    def two_sided(self) -> bool:
        """Whether half of the weights belong to the right operators, and half to the left ones."""

    @property
    def cycles_to_rest(self) -> int:
        """Cycles of the whole range that bring it to rest; 0 if the lowest drive does."""

    @property
    def slow(self) -> "ModelForm":
        """The form of slow motion: without what depends on the rate."""

    def sampled(self, period_s: float) -> "ModelForm":
        """Return the form for records and steps of this period, in s."""

    def straight_line(self) -> FloatArray:
        """Return weights, shape (size,), with which drive and displacement agree."""

    def smallest_slope(self, weights: FloatArray) -> float:
        """Return the smallest slope of the model anywhere; it is monotone if positive."""

    def projected(self, weights: FloatArray) -> FloatArray:
        """Return the weights, shape (size,), projected onto models that can be inverted."""

    def reachable(self, positions: FloatArray) -> FloatArray:
        """Return displacements, shape (n,), or the nearest ones that the form may have."""

    def drives_at(
        self, weights: FloatArray, positions: FloatArray, deadband: float = 0.0
    ) -> FloatArray:
        """Return the drives for a record of displacements, shape (n,).

        Args:
            weights: (size,) weights.
            positions: (n,) displacements that are reachable.
            deadband: Width of the backlash before the memory, in units of the range.
        """

    def positions_at(self, weights: FloatArray, drives: FloatArray) -> FloatArray:
        """Return the displacements for a record of drives in [0, 1], shape (n,).

        Raises:
            ModelError: If the model is not invertible from every reachable state.
        """

    def stage(self, weights: FloatArray) -> SteppedStage:
        """Return a relaxed stage, which makes `positions_at` step by step.

        Raises:
            ModelError: If the model is not invertible from every reachable state.
        """

    def past(self, weights: FloatArray) -> Past:
        """Return the past of a relaxed stage, to follow what it is driven by.

        Args:
            weights: (size,) weights of a model that can be inverted.
        """

    def widest_loop(
        self, weights: FloatArray, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the drives on both branches of the widest loop, shape (n,) each.

        Args:
            weights: (size,) weights.
            positions: (n,) displacements that increase from 0 to 1.

        Returns:
            Drives at these displacements while they rise, and while they fall.
        """

    def position_range(
        self, weights: FloatArray, drives: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest displacement at drives, shape (n,) each.

        No past of slow motion leads beyond them.

        Args:
            weights: (size,) weights.
            drives: (n,) drives in [0, 1].
        """

    def loop(self, positions: FloatArray) -> LoopDrives:
        """Return what gives the drives at these displacements for weights that change.

        Args:
            positions: (n,) displacements that rise once and fall once, from the relaxed state on.
        """

    def as_recorded(self, weights: FloatArray) -> FloatArray:
        """Return weights, shape (..., size), in the order of the record of an experiment."""


@dataclass(frozen=True, eq=False)
class StopForm:
    """An inverse model as a sum of stop operators, paper eq. (16), on a memory of displacements."""

    #: (2, 2 M) thresholds and gains of the stops, from `new_bank`; weights are [a^l, a^r].
    bank: FloatArray

    @classmethod
    def even(cls, order: int) -> "StopForm":
        """Return the form with evenly spaced thresholds, `order` on each side."""
        thresholds = even_thresholds(order)
        return cls(new_bank(thresholds, thresholds))

    @property
    def size(self) -> int:
        """Number of weights, 2 M."""
        return self.bank.shape[1]

    @property
    def two_sided(self) -> bool:
        """True: M weights belong to left stops, and M to right stops."""
        return True

    @property
    def cycles_to_rest(self) -> int:
        """0: the lowest drive clears the memory of turning points."""
        return 0

    @property
    def slow(self) -> "StopForm":
        """The form itself: stops know no rate."""
        return self

    def sampled(self, period_s: float) -> "StopForm":  # noqa: ARG002 - stops know no rate
        """Return the form itself: it is the same for every period."""
        return self

    def straight_line(self) -> FloatArray:
        """Return weights 0: drive and displacement agree."""
        return np.zeros(self.size)

    def inverse(self, weights: FloatArray) -> InverseMPI:
        """Return the inverse model with a relaxed memory, in closed form."""
        left, right = np.split(self.bank[0], 2)
        left_weights, right_weights = np.split(weights, 2)
        return InverseMPI(right, left, right_weights, left_weights)

    def smallest_slope(self, weights: FloatArray) -> float:
        """Return the smallest slope of the model anywhere; it is monotone if positive."""
        return self.inverse(weights).smallest_slope

    def projected(self, weights: FloatArray) -> FloatArray:
        """Return the weights, shape (2 M,), projected onto models that can be inverted."""
        return projected(self.bank, weights)

    def reachable(self, positions: FloatArray) -> FloatArray:
        """Return displacements, shape (n,), or the nearest ones in [0, 1]."""
        return np.clip(positions, 0.0, 1.0)

    def drives_at(
        self, weights: FloatArray, positions: FloatArray, deadband: float = 0.0
    ) -> FloatArray:
        """Return z = x + Σ a_j (E_j - x) for a record of displacements, shape (n,)."""
        return positions + stop_regressors(self.bank, positions, deadband) @ weights

    def positions_at(self, weights: FloatArray, drives: FloatArray) -> FloatArray:
        """Return the displacements for a record of drives in [0, 1], shape (n,)."""
        return self.inverse(weights).exact_inverse().run(drives)

    def stage(self, weights: FloatArray) -> SteppedStage:
        """Return a relaxed stage, which makes `positions_at` step by step."""
        return self.inverse(weights).exact_inverse()

    def past(self, weights: FloatArray) -> StopPast:
        """Return the past of a relaxed stage."""
        return StopPast(self.bank, weights)

    def widest_loop(
        self, weights: FloatArray, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the drives on both branches of the widest loop, shape (n,) each."""
        drives = self.inverse(weights).run(np.concatenate((positions, positions[::-1])))
        return drives[: positions.size], drives[positions.size :][::-1]

    def position_range(
        self, weights: FloatArray, drives: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest displacement at drives, shape (n,) each."""
        rise = np.linspace(0.0, 1.0, 513)
        # These are drives for positions; np.interp needs them to increase, to swap both.
        one, other = (
            np.interp(drives, np.maximum.accumulate(branch), rise)
            for branch in self.widest_loop(weights, rise)
        )
        return np.minimum(one, other), np.maximum(one, other)

    def loop(self, positions: FloatArray) -> StopLoop:
        """Return what gives the drives at these displacements, (n,)."""
        return StopLoop(self.bank, positions)

    def as_recorded(self, weights: FloatArray) -> FloatArray:
        """Return the weights [a^r, a^l] of weights [a^l, a^r], shape (..., 2 M)."""
        return right_first(weights)


def right_first(weights: FloatArray) -> FloatArray:
    """Return the weights [a^r, a^l] of weights [a^l, a^r] of stops, shape (..., 2 M)."""
    left, right = np.split(weights, 2, axis=-1)
    return np.concatenate((right, left), axis=-1)
