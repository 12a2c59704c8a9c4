"""Drift of the learned model from the identified one, as a difference of drives.

The weights alone mean little, because neighbouring operators can exchange slope without an effect
on their sum. This module compares the drives that both models request along the widest loop, up and
down.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from piezod.control.law.model import StageModel
from piezod.hysteresis.memory import FloatArray

_LEVELS = 9


class Learned(Protocol):
    """What an identifier has learned."""

    @property
    def weights(self) -> FloatArray | Sequence[float]:
        """Weights of the model."""

    @property
    def offset(self) -> float:
        """Offset of the displacement, normalised."""

    @property
    def scale(self) -> float:
        """Scale of the displacement."""


class ModelDrift:
    """Compares one identifier with the model that it started from. Real-time safe.

    Args:
        model: The identified model.
        learned: What was learned.
    """

    def __init__(self, model: StageModel, learned: Learned) -> None:
        rise = np.linspace(0.0, 1.0, _LEVELS)
        self._positions: FloatArray = np.concatenate((rise, rise[::-1]))
        self._per_weight = model.form.drive_gradient(model.weights, self._positions)
        self._identified = model.weights.copy()
        self._learned = learned
        self._moved = np.empty_like(self._identified)
        self._drives = np.empty(self._positions.size)
        self._seen = np.empty_like(self._drives)

    def measure(self) -> float:
        """Return the largest difference of the drives, as a share of the range.

        Takes a few µs. The result is NaN if a weight is NaN.
        """
        learned = self._learned
        # The drive changes by the weights, by the scale in proportion to the position, and by the
        # offset. Every result goes into an existing array, so that nothing is allocated.
        np.subtract(learned.weights, self._identified, out=self._moved)
        np.dot(self._per_weight, self._moved, out=self._drives)
        np.multiply(self._positions, learned.scale, out=self._seen)
        self._drives += self._seen
        self._drives -= learned.offset
        np.abs(self._drives, out=self._drives)
        return float(self._drives.max())
