"""The paper's four operators one by one, for study and for checks of the models.

Models do not use these classes: they evaluate all operators together (`bank`), or replace them by a
closed form (`closed_form`).
"""

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from piezod.hysteresis.bank import advance_plays, new_bank, new_bank_memory
from piezod.hysteresis.memory import FloatArray, IntArray, Memory, relax
from piezod.jit import compiled


@compiled
def _step_plays(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    value: float,
) -> float:
    # No dead-band: the operators of the paper have none.
    return advance_plays(Memory(levels, values, now, last, counts), bank, 0.0, value)


class _Operator(ABC):
    """One operator with a threshold 0 < r < 1 and its own memory, paper eq. (1) and eq. (4).

    Raises:
        ModelError: If the threshold is outside (0, 1).
    """

    def __init__(self, threshold: float) -> None:
        self.threshold = threshold
        # A bank of one right and one left play: each operator class reads the one that it needs.
        self._bank = new_bank(threshold, threshold)
        self._memory = new_bank_memory(self._bank)
        self._value = 0.0

    def reset(self) -> None:
        """Return to the relaxed state: input 0, output 0."""
        relax(self._memory)
        self._value = 0.0

    def step(self, value: float) -> float:
        """Return the output for the next input; inputs outside [0, 1] are clamped."""
        self._value = _step_plays(*self._memory, self._bank, value)
        return self._output()

    def run(self, values: npt.ArrayLike) -> FloatArray:
        """Return the outputs, shape (n,), for inputs of shape (n,), from the present state on."""
        return np.array([self.step(value) for value in np.asarray(values, dtype=np.float64)])

    @property
    def _right_play(self) -> float:
        return float(self._memory.now[0])

    @property
    def _left_play(self) -> float:
        return float(self._memory.now[1])

    @abstractmethod
    def _output(self) -> float: ...


class RSPO(_Operator):
    """Right-side play operator F^r, paper eq. (2)."""

    def _output(self) -> float:
        return self._right_play


class LSPO(_Operator):
    """Left-side play operator F^l, paper eq. (5) with max and min exchanged (misprint)."""

    def _output(self) -> float:
        return self._left_play


class RSSO(_Operator):
    """Right-side stop operator E^r = (v - (1 - r) F^l) / r.

    This is paper eq. (10) and eq. (12), corrected.
    """

    def _output(self) -> float:
        return (self._value - (1.0 - self.threshold) * self._left_play) / self.threshold


class LSSO(_Operator):
    """Left-side stop operator E^l = (v - (1 - r) F^r) / r.

    This is paper eq. (11) and eq. (13), corrected.
    """

    def _output(self) -> float:
        return (self._value - (1.0 - self.threshold) * self._right_play) / self.threshold
