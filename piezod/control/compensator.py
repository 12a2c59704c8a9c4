"""The inverse compensator with the paper's switch (its section 3), in normalised units.

One memory, that of the inverse model's operators, serves every mode, so that switching loses
nothing. The modes differ in two numbers only: `strength`, from 0 (the drive is proportional to the
command) to 1 (compensated), and `share`, how far the weights move towards the identifier's in a
cycle. Both are faded over a number of cycles, which makes a switch bumpless in either direction.

What creeps and drifts by itself is left to do so: the hysteresis is asked for the remainder of the
command only, and for the trim on top of it.

The drive never leaves the window that the limits leave open, and the memory advances with the
voltage that is applied, not with the one that was wished: where the two differ, the displacement is
found at which the model gives the applied voltage. It advances in the next step, so that a drive
that was refused leaves no trace.
"""

from typing import NamedTuple

import numpy as np

from piezod.config.modes import Mode
from piezod.hysteresis.bank import (
    advance_plays,
    evaluate_plays,
    new_bank_memory,
    weighted_sum,
)
from piezod.hysteresis.creep import NO_CREEP, Creep, advance_creep
from piezod.hysteresis.memory import (
    MERGED,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
    clamp,
    locate,
)
from piezod.jit import compiled

FOLLOWED_SHARE = 0.3
"""Part of the way to the identifier's weights that mode `adaptive` goes in each cycle. All of it,
as in the paper, would hand the sensor's noise on to the drive."""

POSITION, COMMAND, BEYOND = 0, 1, 2
"""What waits for the next step: the displacement that the memory will advance to if the drive was
applied, NaN for none; the command, to be held where the next one is not a number; and how far the
wished drive lay beyond the window, negative below it."""

_MOST_STEPS = 50  # of the search for a displacement; about ten are needed
_SAME_DRIVE = 1e-13  # a voltage that differs by rounding only is no move


@compiled
def _model(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, position: float
) -> float:
    """Return the model's drive for a displacement; the memory stays as it is."""
    evaluate_plays(memory, bank, locate(memory, position), position, plays)
    return weighted_sum(plays, bank, weights, position)


@compiled
def _position(
    memory: Memory, bank: FloatArray, plays: FloatArray, weights: FloatArray, drive: float
) -> float:
    """Return the displacement for which the model gives a drive, by the Illinois method.

    The model is monotone, 0 at 0 and 1 at 1. Where one end of the bracket stays twice in a row, its
    miss is halved, so that both ends close in.
    """
    drive = clamp(drive, 0.0)
    low, high = 0.0, 1.0
    low_miss, high_miss = -drive, 1.0 - drive
    middle, stayed = memory.last[SEEN], 0
    miss = weighted_sum(memory.now, bank, weights, middle) - drive
    for _ in range(_MOST_STEPS):
        if abs(miss) < _SAME_DRIVE:
            break
        if miss < 0.0:
            low, low_miss = middle, miss
            high_miss *= 0.5 if stayed > 0 else 1.0
            stayed = 1
        else:
            high, high_miss = middle, miss
            low_miss *= 0.5 if stayed < 0 else 1.0
            stayed = -1
        middle = high - high_miss * (high - low) / (high_miss - low_miss)
        miss = _model(memory, bank, plays, weights, middle) - drive
    return middle


@compiled
def _step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    plays: FloatArray,
    pending: FloatArray,
    weights: FloatArray,
    lags: FloatArray,
    creep_gains: FloatArray,
    creep_weights: FloatArray,
    target: FloatArray,
    share: float,
    strength: float,
    command: float,
    added: float,
    low: float,
    high: float,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    if pending[POSITION] == pending[POSITION]:
        advance_plays(memory, bank, 0.0, pending[POSITION])
    crept = advance_creep(lags, creep_gains, creep_weights, memory.last[SEEN])
    for j in range(weights.size):
        weights[j] += share * (target[j] - weights[j])
    command = clamp(command, pending[COMMAND])
    position = clamp(command + added - crept, command)
    model = _model(memory, bank, plays, weights, position)
    wished = model + (1.0 - strength) * (command - model)
    drive = min(max(wished, low), high)
    if drive != model:  # at full strength and within the window it is, to the bit
        position = _position(memory, bank, plays, weights, drive)
    pending[POSITION] = position
    pending[COMMAND] = command
    pending[BEYOND] = wished - drive
    return drive


class Slow(NamedTuple):
    """What a stage does by itself, as it is where the compensator starts.

    Attributes:
        creep: How it creeps.
        lags: (K,) state of the creep.
        zeroed: Creep, in units of the range, that was there when the displacement was zeroed.
    """

    creep: Creep
    lags: FloatArray
    zeroed: float


AT_REST = Slow(NO_CREEP, np.empty(0), 0.0)
"""Of a stage that does not creep."""


class Compensator:
    """Turns a normalised command into a normalised drive, by a mode that may change while it runs.

    Args:
        bank: Thresholds and gains of the inverse model's stops, from `new_bank`.
        weights: (2 M,) weights [a^l, a^r] to start from; all zero for a stage not yet identified.
        mode: The mode to start in.
        fade_cycles: Cycles over which a switch of mode or of weights is spread; at least 1.
        slow: Creep of the stage.
        trimmed_follows: Whether mode `trimmed` is on top of `adaptive`, not of `feedforward`.
    """

    def __init__(
        self,
        bank: FloatArray,
        weights: FloatArray,
        *,
        mode: Mode,
        fade_cycles: int,
        slow: Slow = AT_REST,
        trimmed_follows: bool = False,
    ) -> None:
        self.weights: FloatArray = weights.copy()
        """Weights in use, shape (2 M,); they change while the identifier is followed."""
        self._target = self.weights.copy()
        self._fade_cycles = fade_cycles
        self._has_model = bool(np.any(weights))
        self._memory = new_bank_memory(bank)
        self._adaptive = {Mode.ADAPTIVE, Mode.TRIMMED} if trimmed_follows else {Mode.ADAPTIVE}
        self._following = False
        self.switch(mode)
        self._fading, self._strength = 0, self._strength_aim
        self._offset = 0.0
        self._zeroed = slow.zeroed
        self._pending = np.array([np.nan, 0.0, 0.0])
        plays = np.empty(bank.shape[1])
        creep = (slow.lags.copy(), slow.creep.gains, slow.creep.weights)
        self._arguments = (*self._memory, bank, plays, self._pending, self.weights, *creep)

    @property
    def mode(self) -> Mode:
        """The mode that was asked for last."""
        return self._mode

    @property
    def beyond(self) -> float:
        """How far the last wished drive lay beyond the window, negative below it; normalised."""
        return self._pending.item(BEYOND)

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory had to give up."""
        return int(self._memory.counts[MERGED])

    def switch(self, mode: Mode) -> None:
        """Change the mode; the drive goes over without a jump; may be called in the loop."""
        self._mode = mode
        self._strength_aim = 0.0 if mode is Mode.UNCOMPENSATED else 1.0
        if self._following:
            self._target[:] = self.weights
        self._following = mode in self._adaptive
        self._fading = self._fade_cycles

    def adopt(self, weights: FloatArray) -> None:
        """Go over to other weights, shape (2 M,), without a jump; may be called in the loop."""
        self._target[:] = weights
        self._fading = self._fade_cycles
        self._has_model = True

    def adopt_first(self, weights: FloatArray) -> None:
        """Adopt weights that have converged if there are none yet; may be called in the loop."""
        if not self._has_model:
            self.adopt(weights)

    def refused(self) -> None:
        """Learn that the last drive was not applied; may be called in the loop."""
        self._pending[POSITION] = np.nan

    def step(
        self,
        command: float,
        low: float,
        high: float,
        identified: FloatArray,
        offset: float = 0.0,
        trim: float = 0.0,
    ) -> float:
        """Return the drive for the next command; may be called in the loop.

        Args:
            command: Displacement asked for, in [0, 1]; clamped; not a number means no move.
            low: Lowest drive that the limits allow in this cycle.
            high: Highest drive that the limits allow in this cycle.
            identified: (2 M,) the identifier's weights, followed in mode `adaptive`.
            offset: The identifier's drift of the displacement, followed likewise.
            trim: Displacement to add, in units of the range.
        """
        target = identified if self._following else self._target
        share = 1.0 / self._fading if self._fading else self._following * FOLLOWED_SHARE
        if self._fading:
            self._strength += (self._strength_aim - self._strength) * share
            self._fading -= 1
        if self._following:
            self._offset += share * (offset - self._offset)
        added = self._zeroed - self._offset + trim
        return _step(*self._arguments, target, share, self._strength, command, added, low, high)
