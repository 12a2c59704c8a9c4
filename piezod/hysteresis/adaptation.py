"""Adaptation in the loop: what every identifier offers, and a guard that undoes bad learning."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.online import checked_pairs


class AdaptiveIdentifier(Protocol):
    """Learns the weights of the inverse model pair by pair; all of it may be called in the loop.

    After every step that learned, the inverse of the weights exists.
    """

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place."""

    @property
    def offset(self) -> float:
        """What the operators do not see of the displacement; 0 where it is not learned."""

    @property
    def scale(self) -> float:
        """By how much more than the displacement they see; 0 where it is not learned."""

    @property
    def position(self) -> float:
        """Displacement that the operators see, behind the dead-band."""

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair; return the error, not finite where the pair is not.

        Without `learn` the memory goes on and nothing is learned.
        """

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,)."""

    def predict(self, weights: FloatArray, offset: float, scale: float) -> float:
        """Return the drive that others predict for the last displacement."""

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Take over weights, an offset and a scale, and forget how well they were known."""

    def reset(self) -> None:
        """Forget the past displacement, not what was learned."""


@dataclass
class _Model:
    """A copy of what was learned."""

    weights: FloatArray
    offset: float
    scale: float

    @classmethod
    def of(cls, source: AdaptiveIdentifier) -> "_Model":
        return cls(source.weights.copy(), source.offset, source.scale)

    def assign(self, source: "AdaptiveIdentifier | _Model") -> None:
        self.weights[:] = source.weights
        self.offset, self.scale = source.offset, source.scale


class Shadowed:
    """An identifier that goes back to its last good model where learning made it predict worse.

    Over a window of pairs both models, the one that adapts and its shadow, predict the same drives.
    Where the one that adapts was worse, it goes back to the shadow. Else the model that the window
    began with has proved itself and is the next shadow; a disturbance that was learned at the end
    of one window is so found out in the next.

    Args:
        identifier: What learns; use it through this from here on.
        window: Pairs that were learned from before the two are compared, from 1 on.
        tolerance: How many times the mean squared error of the shadow counts as worse, 1 or more.

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
        self._shadow = _Model.of(identifier)
        self._candidate = _Model.of(identifier)
        self._pairs, self._squares, self._shadow_squares = 0, 0.0, 0.0
        self.restored = 0
        """How often the last good model was restored."""

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, and judge what was learned; return the error."""
        error = self._identifier.step(position, drive, learn)
        if learn and math.isfinite(error):
            shadow = self._shadow
            predicted = self._identifier.predict(shadow.weights, shadow.offset, shadow.scale)
            shadow_error = drive - predicted
            self._squares += error * error
            self._shadow_squares += shadow_error * shadow_error
            self._pairs += 1
            if self._pairs == self._window:
                self._judge()
        return error

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,).

        Raises:
            ModelError: If the shapes differ.
        """
        pairs = zip(*checked_pairs(positions, drives), strict=True)
        return np.array([self.step(float(x), float(v)) for x, v in pairs])

    def predict(self, weights: FloatArray, offset: float, scale: float) -> float:
        """Return the drive that others predict for the last displacement."""
        return self._identifier.predict(weights, offset, scale)

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Take over weights, an offset and a scale, as the last good model too.

        Raises:
            ModelError: If the identifier refuses them.
        """
        self._identifier.adopt(weights, offset, scale)
        self._candidate.assign(self._identifier)
        self._shadow.assign(self._identifier)
        self._begin()

    def reset(self) -> None:
        """Forget the past displacement and the window begun, not what was learned."""
        self._identifier.reset()
        self._begin()

    @property
    def weights(self) -> FloatArray:
        """Weights [a^l, a^r], shape (2 M,); always the same array, which changes in place."""
        return self._identifier.weights

    @property
    def offset(self) -> float:
        """What the operators do not see of the displacement; 0 where it is not learned."""
        return self._identifier.offset

    @property
    def scale(self) -> float:
        """By how much more than the displacement they see; 0 where it is not learned."""
        return self._identifier.scale

    @property
    def position(self) -> float:
        """Displacement that the operators see, behind the dead-band."""
        return self._identifier.position

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return self._identifier.merged_pairs

    def _judge(self) -> None:
        if self._squares > self._tolerance * self._shadow_squares:
            shadow = self._shadow
            self._identifier.adopt(shadow.weights, shadow.offset, shadow.scale)
            self.restored += 1
        else:
            self._shadow.assign(self._candidate)
        self._candidate.assign(self._identifier)
        self._begin()

    def _begin(self) -> None:
        self._pairs, self._squares, self._shadow_squares = 0, 0.0, 0.0
