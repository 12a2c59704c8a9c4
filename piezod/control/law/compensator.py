"""The inverse compensator with the switch of the paper (section 3), in normalised units.

One memory, that of the kernel, serves every mode, so that a change of mode loses nothing.
The modes differ in two numbers only. `strength` is 0 for a drive in proportion to the command and 1
for a compensated drive. `share` is the part of the distance to the identifier's weights that the
weights move in a cycle. Both are faded over a number of cycles, so that no change makes a jump.

The compensator does not counteract creep and drift as such: it subtracts them from the command, and
the hysteresis makes the remainder plus the trim.

The drive never leaves the window of the limits. The memory advances with the applied voltage, not
with the requested one: if they differ, it takes the displacement at which the model gives the
applied voltage. The memory advances in the next step, so that a drive that was not applied leaves
no trace.
"""

from math import isfinite
from typing import Final

import numpy as np

from piezod.config.modes import Mode
from piezod.control.law.creep import AT_REST, CreepState
from piezod.control.law.kernel import BEYOND, CREPT, OUTSIDE, POSITION
from piezod.control.law.kernels import new_kernel
from piezod.control.law.pace import FOLLOWED_SHARE
from piezod.hysteresis import LearnedModel, ModelForm
from piezod.hysteresis.memory import FloatArray

CREEP_BEYOND: Final = 0.01
"""Share of the range by which creep after a move may ask for a displacement outside."""


class Compensator:
    """Turns a normalised command into a normalised drive. Its methods are real-time safe.

    Args:
        form: Form of the model.
        weights: (form.size,) initial weights; all zero if the stage is not yet identified.
        mode: The mode in which it starts.
        fade_cycles: Cycles over which a change of mode or of weights is faded; at least 1.
        share: Share of the distance to the identifier's weights that mode `adaptive` moves in each
            cycle, above 0 to 1.
        creep: Creep so far, and the displacement.
        learning: Modes in which the weights in use follow the identifier.
    """

    def __init__(
        self,
        form: ModelForm,
        weights: FloatArray,
        *,
        mode: Mode,
        fade_cycles: int,
        share: float = FOLLOWED_SHARE,
        creep: CreepState = AT_REST,
        learning: frozenset[Mode] = frozenset({Mode.ADAPTIVE, Mode.CLOSED}),
    ) -> None:
        self.weights: FloatArray = weights.copy()
        """Weights in use, shape (size,); they change in place if they follow the identifier."""
        self.surface = not form.two_sided
        """Whether they are the coefficients of a surface, and not the weights of stops."""
        self.rest_depends_on_path = form.cycles_to_rest > 0
        """Whether the displacement at rest depends on the path of the drive before."""
        self._offset, self._scale = 0.0, 0.0
        self._target = LearnedModel(weights.copy())
        self._fade_cycles, self._share = fade_cycles, share
        self._has_model = bool(np.any(weights))
        self._learning = learning
        self._following, self._uses_learned = False, True
        self.switch(mode)
        self._fading, self._strength = 0, self._strength_aim
        self._zeroed = creep.zeroed
        # The kernel changes weights and lags in place.
        self._kernel = new_kernel(form, self.weights, creep._replace(lags=creep.lags.copy()))
        self._step = self._kernel.step
        self._take_carried()

    @property
    def offset(self) -> float:
        """Offset of the displacement in use, in units of the range."""
        return self._offset

    @property
    def scale(self) -> float:
        """Relative gain of the hysteresis input over the displacement in use."""
        return self._scale

    @property
    def learns_in_use(self) -> bool:
        """Whether it follows the identifier alone: no fade is left of an earlier model."""
        return self._following and not self._fading

    @property
    def out_of_reach(self) -> bool:
        """Whether the last displacement was asked for farther outside than creep explains."""
        return self._strength_aim > 0.0 and abs(self._outside) > CREEP_BEYOND

    @property
    def limited_direction(self) -> int:
        """1 if the last drive or displacement could go no higher, -1 if no lower, else 0."""
        excess = self._beyond or self._outside
        return (excess > 0.0) - (excess < 0.0)

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return self._kernel.merged_pairs

    def switch(self, mode: Mode, proven: LearnedModel | None = None) -> None:
        """Change the mode; the drive changes over without a jump.

        Args:
            mode: The mode.
            proven: Model to use when the mode no longer follows the identifier; None for the one
                in use.
        """
        self.mode = mode
        """The present mode."""
        self._strength_aim = 0.0 if mode is Mode.UNCOMPENSATED else 1.0
        if self._following:
            self._target.assign(proven or self)
        self._following = self._uses_learned and mode in self._learning
        self.fade()

    def use_learned(self, used: bool, first: LearnedModel) -> None:
        """Follow the identifier in the modes that do, or use another model; without a jump.

        Args:
            used: Whether to follow it.
            first: The model to use if not.
        """
        if used is self._uses_learned:
            return
        self._uses_learned = used
        if self.mode in self._learning:
            self._following = used
            self._target.assign(first)
            self.fade()

    @property
    def adapts(self) -> bool:
        """Whether the mode is one that follows the identifier."""
        return self.mode in self._learning

    def fade(self) -> None:
        """Approach the weights evenly from now on, without a jump."""
        self._fading = self._fade_cycles
        in_use = float(self.weights.sum()) + self._offset + self._scale
        if not isfinite(in_use):  # a fade would keep NaN
            self.weights[:] = self._target.weights
            self._offset, self._scale = self._target.offset, self._target.scale

    def adopt(self, weights: FloatArray) -> None:
        """Change over to other weights, shape (size,), without a jump."""
        self._target.weights[:] = weights
        self._fading = self._fade_cycles
        self._has_model = True

    def restart(self, model: LearnedModel) -> None:
        """Change over to a model in every mode, without a jump: what was learned is dropped."""
        self._target.assign(model)
        self.fade()

    def adopt_first(self, weights: FloatArray) -> bool:
        """Adopt converged weights if there are none yet; return whether it did."""
        if self._has_model:
            return False
        self.adopt(weights)
        return True

    def zero(self, zero: float) -> None:
        """Take the present displacement as zero: the stage rests, and its sensor was zeroed.

        Args:
            zero: The zero of the sensor, normalised.
        """
        self._zeroed += self.expected - zero

    @property
    def expected(self) -> float:
        """Displacement that the sensor is expected to show after the last drive, normalised."""
        # Inverse of the map in `step`: what the hysteresis has, plus creep and drift, as the sensor
        # shows it.
        return (self.position + self._crept + self._offset) / (1.0 + self._scale) - self._zeroed

    def holding_command(self, drive: float, trim: float) -> float:
        """Return the command that keeps a drive.

        Args:
            drive: Drive in force, normalised.
            trim: Displacement that the trim adds, in units of the range.
        """
        return self.expected - trim / (1.0 + self._scale) if self._strength_aim else drive

    def discard_last(self) -> None:
        """Take back the last drive: it was not applied."""
        self._kernel.discard_last()
        self._take_carried()

    def _take_carried(self) -> None:
        """Take what the kernel has left, as numbers of Python: they cost less to read."""
        carried: list[float] = self._kernel.carried.tolist()
        self._beyond, self._outside = carried[BEYOND], carried[OUTSIDE]
        self.position, self._crept = carried[POSITION], carried[CREPT]
        """Displacement of the hysteresis after the last drive that was applied, and the creep."""
        self.limited = self._beyond != 0.0
        """Whether the window limited the last requested drive."""

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
        """Return the drive for the next command.

        Args:
            command: Command in [0, 1]; clamped. NaN means no move.
            low: Lowest drive that the limits allow in this cycle.
            high: Highest drive that the limits allow in this cycle.
            identified: (size,) weights of the identifier, followed in mode `adaptive`.
            offset: Offset of the identifier, followed likewise.
            scale: Scale of the identifier, followed likewise.
            trim: Displacement to add, in units of the range.
        """
        target = identified
        if not self._following:
            target, offset, scale = self._target.weights, self._target.offset, self._target.scale
        # With n cycles left, 1/n of the remaining distance in each makes a straight fade that ends
        # exactly.
        share = self._share if self._following else 0.0
        if self._fading:
            share = 1.0 / self._fading
            self._strength += (self._strength_aim - self._strength) * share
            self._fading -= 1
        self._offset += share * (offset - self._offset)
        self._scale += share * (scale - self._scale)
        stretch = 1.0 + self._scale
        # The sensor's zero contains what was there at that instant, so it is added to the command.
        added = stretch * self._zeroed - self._offset + trim
        drive = self._step(target, share, self._strength, command, stretch, added, low, high)
        self._take_carried()
        return drive


class DriveHistory:
    """A ring of the voltages that were in force, one entry per cycle. Fixed memory, real-time safe.

    Between entries the voltage is interpolated linearly, as for recorded data, so that a delay that
    was identified from a record has the same meaning here.

    Args:
        in_force_v: Voltage in force before the first entry, in V.
        entries: Number of cycles that are kept; earlier times get the oldest voltage.
    """

    def __init__(self, in_force_v: float, entries: int) -> None:
        self._t_ns = [0] * entries
        self._drive_v = [in_force_v] * entries
        self._newest = 0
        self._empty = True

    def append(self, t_ns: int, drive_v: float) -> None:
        """Store the voltage in force at an instant, later than all before, in V."""
        if self._empty:
            self._t_ns = [t_ns] * len(self._t_ns)
            self._empty = False
        self._newest = newest = (self._newest + 1) % len(self._t_ns)
        self._t_ns[newest] = t_ns
        self._drive_v[newest] = drive_v

    def at(self, t_ns: int) -> float:
        """Return the voltage that was in force at an instant, in V."""
        index = later = self._newest
        # Newest first: a delay is a few cycles, so this ends after a few steps.
        for _ in range(len(self._t_ns)):
            if self._t_ns[index] <= t_ns:
                return self._between(index, later, t_ns)
            later, index = index, index - 1
        return self._drive_v[later]

    def _between(self, earlier: int, later: int, t_ns: int) -> float:
        span_ns = self._t_ns[later] - self._t_ns[earlier]
        if span_ns <= 0:
            return self._drive_v[earlier]
        part = (t_ns - self._t_ns[earlier]) / span_ns
        return self._drive_v[earlier] + (self._drive_v[later] - self._drive_v[earlier]) * part
