"""Base class of all identifiers that learn pair by pair, and the guard that undoes bad learning."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.adaptation import AdaptiveIdentifier, LearnedModel
from piezod.hysteresis.bank import checked_deadband, checked_pairs, new_bank_memory
from piezod.hysteresis.learner import (
    OFFSET,
    POSITION,
    SCALE,
    SCALE_LIMIT,
    SLOPE_MARGIN,
    new_learner,
    predicted_drive,
)
from piezod.hysteresis.memory import MERGED, SEEN, FloatArray, Memory, assign_memory, relax
from piezod.hysteresis.slopes import projected


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
        memory, learner = self._memory, self._learner
        # Bound once: a partial function adds no Python frame.
        self.predict: Callable[[FloatArray, float, float], float] = partial(
            predicted_drive, memory.now, memory.last, learner.bank, learner.scalars
        )
        """Returns the drive that a model of these weights, offset and scale predicts for the last
        displacement. Real-time safe."""
        self.offset = self.scale = 0.0
        """Offset of the displacement against the operator input, in units of the range; relative
        gain of the operator input over the displacement: y = (1 + scale) x - offset."""
        self.weights: FloatArray = learner.weights
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place.

        Use `adopt` to set them.
        """
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
        self._take_scalars()
        return errors

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
        self._take_scalars()

    def _take_scalars(self) -> None:
        """Take offset and scale from the kernel, as numbers of Python: they cost less to read."""
        scalars: list[float] = self._learner.scalars.tolist()
        self.offset, self.scale = scalars[OFFSET], scalars[SCALE]

    def approach(self, model: LearnedModel, share: float) -> None:
        """Go a share of the way to another model; the uncertainty stays. Real-time safe.

        Args:
            model: Model that can be inverted, of the same size.
            share: Share of the way, in [0, 1].
        """
        scalars, weights = self._learner.scalars, self.weights
        weights += share * (model.weights - weights)
        scalars[OFFSET] += share * (model.offset - scalars[OFFSET])
        scalars[SCALE] += share * (model.scale - scalars[SCALE])
        scalars[SLOPE_MARGIN] = 0.0  # as in `adopt`
        self._take_scalars()

    @abstractmethod
    def expect_noise(self, variance: float) -> None:
        """Trust the next pairs less if they have more noise than usual."""

    def take_over(self, memory: Memory) -> None:
        """Take over the hysteresis memory of a stage of the same form, see `past`."""
        assign_memory(self._memory, memory)
        self._learner.scalars[POSITION] = (self.position + self.offset) / (1.0 + self.scale)

    def reset(self) -> None:
        """Clear the hysteresis memory; the learned model stays."""
        relax(self._memory)
        # The displacement at which the operator input is 0, as in the relaxed memory.
        self._learner.scalars[POSITION] = self.offset / (1.0 + self.scale)

    @property
    def position(self) -> float:
        """Displacement at the input of the operators, after the dead-band. Real-time safe."""
        return float(self._memory.last[SEEN])

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])


class Shadowed:
    """Identifier that returns to its last good model if learning made it predict worse.

    Over a window of pairs, the adapting model and its shadow predict the same drives. If the
    adapting model was worse, it is replaced by the shadow. Otherwise the model from the start of
    the window has proved itself and becomes the next shadow. A disturbance that was learned at the
    end of one window is thus detected in the next window.

    Args:
        identifier: The identifier to guard; from now on use it only through this object.
        window: Number of learned pairs between two comparisons, at least 1.
        tolerance: Ratio of the mean squared errors above which the adapting model counts as worse,
            at least 1.

    Raises:
        ModelError: If an argument is outside its range.
    """

    def __init__(
        self, identifier: AdaptiveIdentifier, *, window: int = 1000, tolerance: float = 2.0
    ) -> None:
        if window < 1 or not 1.0 <= tolerance < math.inf:
            message = (
                "a shadow needs a window of 1 pair or more and a tolerance of 1 or more, "
                f"got {window} and {tolerance:g}"
            )
            raise ModelError(message)
        self._identifier = identifier
        # Those of the identifier itself: a call less in each cycle.
        self.predict: Callable[[FloatArray, float, float], float] = identifier.predict
        """Returns the drive that a model of these weights, offset and scale predicts for the last
        displacement."""
        self.expect_noise: Callable[[float], None] = identifier.expect_noise
        """Lets it trust the next pairs less if they have more noise than usual."""
        self.weights = identifier.weights
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place."""
        self.offset, self.scale = identifier.offset, identifier.scale
        """Offset and scale that it has learned; 0 if it learns none."""
        self._window, self._tolerance = window, tolerance
        self._shadow = LearnedModel.of(identifier)
        self._candidate = LearnedModel.of(identifier)  # the model at the start of the window
        self._pairs, self._squares, self._shadow_squares = 0, 0.0, 0.0
        self.restored = 0
        """Number of times that the last good model was restored."""

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, and compare the models at the end of a window; return the error."""
        error = self._identifier.step(position, drive, learn)
        # Only learned pairs count: in others the two models cannot differ by what was learned.
        if learn and error - error == 0.0:  # finite
            shadow = self._shadow
            predicted = self.predict(shadow.weights, shadow.offset, shadow.scale)
            shadow_error = drive - predicted
            self._squares += error * error
            self._shadow_squares += shadow_error * shadow_error
            self._pairs += 1
            if self._pairs == self._window:
                self._compare()
        self.offset, self.scale = self._identifier.offset, self._identifier.scale
        return error

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,).

        Raises:
            ModelError: If the shapes differ.
        """
        # Step by step, because a restoration in between changes the following errors.
        pairs = zip(*checked_pairs(positions, drives), strict=True)
        return np.array([self.step(float(x), float(v)) for x, v in pairs])

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, of the last good model too.

        Raises:
            ModelError: If the identifier refuses them.
        """
        self._identifier.adopt(weights, offset, scale)
        # From the identifier, which may have projected the weights.
        self._candidate.assign(self._identifier)
        self._shadow.assign(self._identifier)
        self._take_scalars()
        self._begin_window()

    def _take_scalars(self) -> None:
        self.offset, self.scale = self._identifier.offset, self._identifier.scale

    def approach(self, model: LearnedModel, share: float) -> None:
        """Go a share of the way to another model; the uncertainty stays."""
        self._identifier.approach(model, share)
        self._take_scalars()

    def take_over(self, memory: Memory) -> None:
        """Take over the hysteresis memory of a stage of the same form, see `past`."""
        self._identifier.take_over(memory)

    def reset(self) -> None:
        """Clear the hysteresis memory and start a new window; the learned model stays."""
        self._identifier.reset()
        self._begin_window()

    @property
    def position(self) -> float:
        """Displacement at the input of the operators, after the dead-band."""
        return self._identifier.position

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return self._identifier.merged_pairs

    def _compare(self) -> None:
        """Restore the shadow if the adapting model predicted worse, else renew the shadow."""
        if self._squares > self._tolerance * self._shadow_squares:
            shadow = self._shadow
            self._identifier.adopt(shadow.weights, shadow.offset, shadow.scale)
            self.restored += 1
        else:
            # Not the present model: only the one from the start of the window has been tested.
            self._shadow.assign(self._candidate)
        self._candidate.assign(self._identifier)
        self._begin_window()

    def _begin_window(self) -> None:
        self._pairs, self._squares, self._shadow_squares = 0, 0.0, 0.0
