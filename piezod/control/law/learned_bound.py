"""How far the learned model may be from the identified one, as a difference of drives.

The weights alone mean little, because neighbouring operators can exchange slope without an effect
on their sum. So the drives that both models request along the widest loop are compared, up and
down. That covers slopes, gain and drift of every form with one number.

A sensor whose gain or zero lies looks like a stage that has changed. The bound limits what such a
lie can teach: at the bound, learning goes on within it.
"""

from math import isfinite
from typing import Final

import numpy as np

from piezod.control.law.model import StageModel
from piezod.hysteresis import LearnedModel
from piezod.hysteresis.adaptation import Adaptable, AdaptiveIdentifier
from piezod.units import NS_PER_S

_LEVELS = 9
"""Displacements on each branch. Between them, just after the turn, the difference may be larger, by
a few percent of the range."""
LOOK_NS: Final = NS_PER_S // 50
"""Interval between two measurements of the difference, which takes 10 to 20 µs."""
MEAN_NS: Final = 5 * NS_PER_S
"""Time constant of the mean difference: motion soon corrects what a disturbance has taught."""


class ModelDrift:
    """Compares learned models with the identified one. Real-time safe.

    Args:
        model: The identified model.
    """

    def __init__(self, model: StageModel) -> None:
        rise = np.linspace(0.0, 1.0, _LEVELS)
        self._loop = model.form.loop(np.concatenate((rise, rise[-2::-1])))
        self._identified = self._loop.of(LearnedModel(model.weights)).copy()

    def measure(self, learned: Adaptable | LearnedModel) -> float:
        """Return the largest difference of the drives, as a share of the range.

        Takes 10 to 20 µs.

        Args:
            learned: What was learned; finite.
        """
        drives = self._loop.of(learned)
        np.subtract(drives, self._identified, out=drives)
        np.abs(drives, out=drives)
        return float(drives.max())


class LearnedBound:
    """Keeps a learned model within a distance of the identified one. Real-time safe.

    Args:
        model: The identified model.
        adaptation: What learns; it starts from the weights of the model.
        limit: Largest distance, as a share of the range.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self, model: StageModel, adaptation: AdaptiveIdentifier, limit: float, period_ns: int
    ) -> None:
        self._adaptation, self._first = adaptation, LearnedModel(model.weights.copy())
        self._drift = ModelDrift(model)
        self._look_cycles = max(LOOK_NS // period_ns, 1)
        self._cycles, self._share = 0, min(self._look_cycles * period_ns / MEAN_NS, 1.0)
        self.limit = limit
        """Largest distance, as a share of the range."""
        self.distance = 0.0
        """Mean distance over some seconds, as a share of the range."""

    def update(self) -> None:
        """Look at the learned model now and then, and bring it back to the bound.

        Call once per cycle.
        """
        self._cycles += 1
        if self._cycles < self._look_cycles:
            return
        self._cycles = 0
        distance = self._limit(self._adaptation)
        self.distance += self._share * (min(distance, self.limit) - self.distance)

    def _limit(self, learned: AdaptiveIdentifier | LearnedModel) -> float:
        """Bring a learned model back to the bound; return how far it was."""
        if not is_finite(learned):  # a fault of its own, D2
            return 0.0
        distance = self._drift.measure(learned)
        if distance > self.limit:
            # The models that can be inverted are a convex set: each one on the way is in it.
            learned.approach(self._first, 1.0 - self.limit / distance)
        return distance

    def limited(self, learned: LearnedModel) -> LearnedModel:
        """Return a learned model, brought back to the bound if it is beyond it."""
        self._limit(learned)
        return learned

    def returned(self) -> None:
        """Note that the learned model is the identified one again."""
        self.distance = 0.0


def is_finite(learned: Adaptable | LearnedModel) -> bool:
    """Return whether all learned numbers are finite. Real-time safe."""
    # One NaN or infinity makes the sum not finite, too.
    return isfinite(float(learned.weights.sum()) + learned.offset + learned.scale)
