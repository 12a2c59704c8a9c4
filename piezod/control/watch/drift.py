"""Drift of the learned model from the identified one, as a difference of drives.

The weights alone mean little, because neighbouring operators can exchange slope without an effect
on their sum. This module compares the drives that both models request along the widest loop, up and
down.
"""

import numpy as np

from piezod.control.law.model import StageModel
from piezod.hysteresis import LearnedModel
from piezod.hysteresis.adaptation import Adaptable

_LEVELS = 9
"""Displacements on each branch. Between them, just after the turn, the difference may be larger, by
a few percent of the range."""


class ModelDrift:
    """Compares one identifier with the model that it started from. Real-time safe.

    Args:
        model: The identified model.
        learned: What was learned; finite.
    """

    def __init__(self, model: StageModel, learned: Adaptable) -> None:
        rise = np.linspace(0.0, 1.0, _LEVELS)
        self._loop = model.form.loop(np.concatenate((rise, rise[-2::-1])))
        self._identified = self._loop.of(LearnedModel(model.weights)).copy()
        self._learned = learned

    def measure(self) -> float:
        """Return the largest difference of the drives, as a share of the range.

        Takes 10 to 20 µs.
        """
        drives = self._loop.of(self._learned)
        np.subtract(drives, self._identified, out=drives)
        np.abs(drives, out=drives)
        return float(drives.max())
