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

from math import isfinite

import numpy as np

from piezod.config.modes import Mode
from piezod.control.law.creep import AT_REST, CreepState
from piezod.control.law.step import BEYOND, OUTSIDE, POSITION, step
from piezod.hysteresis.bank import new_bank_memory
from piezod.hysteresis.memory import MERGED, SEEN, FloatArray

FOLLOWED_SHARE = 0.3
"""Part of the way to the identifier's weights that mode `adaptive` goes in each cycle. All of it,
as in the paper, would hand the sensor's noise on to the drive."""


class Compensator:
    """Turns a normalised command into a normalised drive, by a mode that may change while it runs.

    Args:
        bank: Thresholds and gains of the inverse model's stops, from `new_bank`.
        weights: (2 M,) weights [a^l, a^r] to start from; all zero for a stage not yet identified.
        mode: The mode to start in.
        fade_cycles: Cycles over which a switch of mode or of weights is spread; at least 1.
        creep: How far the stage has crept, and where it is.
        trimmed_follows: Whether mode `trimmed` is on top of `adaptive`, not of `feedforward`.
    """

    def __init__(
        self,
        bank: FloatArray,
        weights: FloatArray,
        *,
        mode: Mode,
        fade_cycles: int,
        creep: CreepState = AT_REST,
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
        self._offset, self._scale = 0.0, 0.0
        self._zeroed, self._lags = creep.zeroed, creep.lags.copy()
        self._creep_weights = creep.creep.weights
        self._pending = np.array([creep.quick, creep.quick, 0.0, 0.0])
        self._arguments = (
            *self._memory,
            bank,
            np.empty(bank.shape[1]),
            self._pending,
            self.weights,
            self._lags,
            creep.creep.gains,
            self._creep_weights,
        )

    @property
    def mode(self) -> Mode:
        """The mode that was asked for last."""
        return self._mode

    @property
    def limited(self) -> bool:
        """Whether the window cut off part of the last wished drive."""
        return self._pending.item(BEYOND) != 0.0

    @property
    def stop(self) -> int:
        """1 where the last drive or displacement could go no higher, -1 no lower, else 0."""
        excess = self._pending.item(BEYOND) or self._pending.item(OUTSIDE)
        return (excess > 0.0) - (excess < 0.0)

    @property
    def position(self) -> float:
        """Displacement that the operators see once the last drive acts, unless it was refused."""
        pending: float = self._pending.item(POSITION)
        return pending if isfinite(pending) else self._memory.last.item(SEEN)

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

    def zero(self) -> None:
        """Count from here on: the stage rests, and its sensor was zeroed; call it in the loop."""
        self._zeroed = float(self._creep_weights @ self._lags)

    @property
    def expected(self) -> float:
        """Displacement that the sensor is expected to show once the last drive acts, normalised."""
        crept = float(self._creep_weights @ self._lags)
        return (self.position + crept + self._offset) / (1.0 + self._scale) - self._zeroed

    def command_here(self, drive: float, trim: float) -> float:
        """Return the command that asks for what a drive has brought; may be called in the loop.

        Args:
            drive: Drive in force, normalised.
            trim: Displacement that is added, in units of the range.
        """
        return self.expected - trim / (1.0 + self._scale) if self._strength_aim else drive

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
        scale: float = 0.0,
        trim: float = 0.0,
    ) -> float:
        """Return the drive for the next command; may be called in the loop.

        Args:
            command: Displacement asked for, in [0, 1]; clamped; not a number means no move.
            low: Lowest drive that the limits allow in this cycle.
            high: Highest drive that the limits allow in this cycle.
            identified: (2 M,) the identifier's weights, followed in mode `adaptive`.
            offset: The identifier's drift of the displacement, followed likewise.
            scale: The identifier's scale of the displacement, followed likewise.
            trim: Displacement to add, in units of the range.
        """
        target = identified if self._following else self._target
        share = 1.0 / self._fading if self._fading else self._following * FOLLOWED_SHARE
        if self._fading:
            self._strength += (self._strength_aim - self._strength) * share
            self._fading -= 1
        if self._following:
            self._offset += share * (offset - self._offset)
            self._scale += share * (scale - self._scale)
        stretch = 1.0 + self._scale
        added = stretch * self._zeroed - self._offset + trim
        wish = command, stretch, added
        return step(*self._arguments, target, share, self._strength, *wish, low, high)
