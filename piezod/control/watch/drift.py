"""How far what was learned is from what was identified, as voltages and not as weights.

Weights by themselves tell little: neighbours trade slope for slope. What counts is the drive that
they ask for, all the way up the widest loop and down again.
"""

import numpy as np

from piezod.control.law.model import StageModel
from piezod.hysteresis.adaptation import AdaptiveIdentifier
from piezod.hysteresis.bank import GAINS, advance_plays, new_bank_memory
from piezod.hysteresis.memory import FloatArray

_POINTS = 9


class ModelDrift:
    """Compares one identifier with the model that it started from.

    Args:
        model: The identified model.
        adaptation: What learns.
    """

    def __init__(self, model: StageModel, adaptation: AdaptiveIdentifier) -> None:
        rise = np.linspace(0.0, 1.0, _POINTS)
        self._positions: FloatArray = np.concatenate((rise, rise[::-1]))
        memory = new_bank_memory(model.bank)
        rows = []
        for position in self._positions:
            advance_plays(memory, model.bank, 0.0, float(position))
            rows.append(model.bank[GAINS] * (position - memory.now))
        self._per_weight = np.array(rows)
        self._identified = model.weights.copy()
        self._adaptation = adaptation
        self._moved = np.empty_like(self._identified)
        self._drives = np.empty(self._positions.size)
        self._seen = np.empty_like(self._drives)

    def measure(self) -> float:
        """Return by how much of its range the drive differs at most; NaN where a weight is NaN.

        Takes a few µs; may be called in the loop.
        """
        learned = self._adaptation
        np.subtract(learned.weights, self._identified, out=self._moved)
        np.dot(self._per_weight, self._moved, out=self._drives)
        np.multiply(self._positions, learned.scale, out=self._seen)
        self._drives += self._seen
        self._drives -= learned.offset
        np.abs(self._drives, out=self._drives)
        return float(self._drives.max())
