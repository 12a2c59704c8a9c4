"""Interface of the adaptive identifiers, and a shadow model that undoes bad learning."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.online import checked_pairs


class AdaptiveIdentifier(Protocol):
    """Learns the weights of the inverse model pair by pair. Real-time safe.

    After every learning step the inverse of the learned model exists.
    """

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place."""

    @property
    def offset(self) -> float:
        """Offset of the displacement against the operator input; 0 if not learned."""

    @property
    def scale(self) -> float:
        """Relative gain of the operator input over the displacement; 0 if not learned."""

    @property
    def position(self) -> float:
        """Displacement at the input of the operators, after the dead-band."""

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair; return the error, which is not finite if the pair is not.

        Without `learn` the memory advances and the model stays.
        """

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,)."""

    def predict(self, weights: FloatArray, offset: float, scale: float) -> float:
        """Return the drive that another model predicts for the last displacement."""

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, and restart their uncertainty."""

    def reset(self) -> None:
        """Clear the hysteresis memory; the learned model stays."""


@dataclass
class _LearnedModel:
    """Copy of a learned model: weights, offset and scale."""

    weights: FloatArray
    offset: float
    scale: float

    @classmethod
    def of(cls, source: AdaptiveIdentifier) -> "_LearnedModel":
        return cls(source.weights.copy(), source.offset, source.scale)

    def assign(self, source: "AdaptiveIdentifier | _LearnedModel") -> None:
        self.weights[:] = source.weights
        self.offset, self.scale = source.offset, source.scale


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
        self._window, self._tolerance = window, tolerance
        self._shadow = _LearnedModel.of(identifier)
        self._candidate = _LearnedModel.of(identifier)  # the model at the start of the window
        self._pairs, self._squares, self._shadow_squares = 0, 0.0, 0.0
        self.restored = 0
        """Number of times that the last good model was restored."""

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, and compare the models at the end of a window; return the error."""
        error = self._identifier.step(position, drive, learn)
        # Only learned pairs count: in others the two models cannot differ by what was learned.
        if learn and math.isfinite(error):
            shadow = self._shadow
            predicted = self._identifier.predict(shadow.weights, shadow.offset, shadow.scale)
            shadow_error = drive - predicted
            self._squares += error * error
            self._shadow_squares += shadow_error * shadow_error
            self._pairs += 1
            if self._pairs == self._window:
                self._compare()
        return error

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,).

        Raises:
            ModelError: If the shapes differ.
        """
        # Step by step, because a restoration in between changes the following errors.
        pairs = zip(*checked_pairs(positions, drives), strict=True)
        return np.array([self.step(float(x), float(v)) for x, v in pairs])

    def predict(self, weights: FloatArray, offset: float, scale: float) -> float:
        """Return the drive that another model predicts for the last displacement."""
        return self._identifier.predict(weights, offset, scale)

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, of the last good model too.

        Raises:
            ModelError: If the identifier refuses them.
        """
        self._identifier.adopt(weights, offset, scale)
        # From the identifier, which may have projected the weights.
        self._candidate.assign(self._identifier)
        self._shadow.assign(self._identifier)
        self._begin_window()

    def reset(self) -> None:
        """Clear the hysteresis memory and start a new window; the learned model stays."""
        self._identifier.reset()
        self._begin_window()

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place."""
        return self._identifier.weights

    @property
    def offset(self) -> float:
        """Offset of the displacement against the operator input; 0 if not learned."""
        return self._identifier.offset

    @property
    def scale(self) -> float:
        """Relative gain of the operator input over the displacement; 0 if not learned."""
        return self._identifier.scale

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
