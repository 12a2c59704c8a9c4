"""What every identifier that learns pair by pair offers."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy.typing as npt

from piezod.hysteresis.memory import FloatArray, Memory


class Adaptable(Protocol):
    """A model of a stage that changes while the stage runs."""

    @property
    def weights(self) -> FloatArray:
        """Weights, shape (size,); always the same array, which changes in place."""

    @property
    def offset(self) -> float:
        """Offset of the displacement against the operator input; 0 if not learned."""

    @property
    def scale(self) -> float:
        """Relative gain of the operator input over the displacement; 0 if not learned."""


@dataclass
class LearnedModel:
    """Copy of a learned model."""

    weights: FloatArray  #: (size,) weights of the form.
    offset: float = 0.0  #: Offset of the displacement.
    scale: float = 0.0  #: Relative gain of the operator input over the displacement.

    @classmethod
    def of(cls, source: Adaptable) -> Self:
        """Return a copy of a model."""
        return cls(source.weights.copy(), source.offset, source.scale)

    def assign(self, source: "Adaptable | LearnedModel") -> None:
        """Take over another model. Real-time safe."""
        self.weights[:] = source.weights
        self.offset, self.scale = source.offset, source.scale

    def approach(self, model: "LearnedModel", share: float) -> None:
        """Go a share of the way to another model. Real-time safe."""
        self.weights += share * (model.weights - self.weights)
        self.offset += share * (model.offset - self.offset)
        self.scale += share * (model.scale - self.scale)


class AdaptiveIdentifier(Adaptable, Protocol):
    """Learns the weights of a model pair by pair. Real-time safe.

    After every learning step the inverse of the learned model exists.
    """

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

    def predict(self, weights: FloatArray, offset: float, scale: float, /) -> float:
        """Return the drive that another model predicts for the last displacement."""

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, and restart their uncertainty."""

    def approach(self, model: LearnedModel, share: float) -> None:
        """Go a share of the way to a model that can be inverted; the uncertainty stays."""

    def expect_noise(self, variance: float, /) -> None:
        """Trust the next pairs less than usual if their displacement has more noise than usual.

        Args:
            variance: Variance of the noise, in units of the range squared.
        """

    def take_over(self, memory: Memory) -> None:
        """Take over the hysteresis memory of a stage of the same form, see `past`."""

    def reset(self) -> None:
        """Clear the hysteresis memory; the learned model stays."""
