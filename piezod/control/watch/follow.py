"""Tests whether the displacement follows the drive: S9. Adaptation cannot hide this fault.

If there is a model, the position must lie between the branches of the widest loop, whatever the
past of the stage; a part that relaxes along the path may lead beyond them near the ends. With or
without a model, the position must rise if the drive rises, and fall if it falls, once a stride is
long enough.
"""

from math import copysign
from typing import Final

import numpy as np

from piezod.control.law.model import StageModel
from piezod.control.signals import RecentRange
from piezod.units import NS_PER_S

_INTERVALS: Final = 64
_LAST: Final = 64.0


class Plausible:
    """The positions that an identified stage can have, as a table that no learning changes.

    Real-time safe.
    """

    def __init__(self, model: StageModel) -> None:
        grid = np.linspace(0.0, 1.0, _INTERVALS + 1)
        low, high = model.form.position_range(model.weights, grid)
        self._low: list[float] = low.tolist()
        self._high: list[float] = high.tolist()
        self._low_v, self._width_v = model.drive_v.low, model.drive_v.width

    def low(self, drive_v: float) -> float:
        """Return the lowest position without creep at this drive, or at a higher one.

        Args:
            drive_v: The drive, finite, in V.

        Returns:
            Position in units of the model's range.
        """
        return self._at(drive_v, self._low)

    def high(self, drive_v: float) -> float:
        """Return the highest position at this drive, or at a lower one, likewise."""
        return self._at(drive_v, self._high)

    def _at(self, drive_v: float, table: list[float]) -> float:
        place = (drive_v - self._low_v) / self._width_v * _LAST
        if place <= 0.0:
            place = 0.0
        elif place >= _LAST:
            place = _LAST
        index = int(place)
        if index == _INTERVALS:
            index -= 1
        return table[index] + (table[index + 1] - table[index]) * (place - index)


MARGIN: Final = 0.1
"""Creep, drift and a load may move a stage this far beyond the widest loop, as a share of the
range. An offset of the sensor or a wrong gain moves it farther."""
OUTSIDE_CYCLES, OUTSIDE_NS = 20, NS_PER_S // 100
"""The position is implausible after this time outside, whichever is longer. Cycles inside count
back."""
STRIDE: Final = 0.02
"""Shortest stride, as a share of the drive's range."""
STRIDE_CYCLES, STRIDE_ANSWERS = 20, 4
"""A stride lasts at least this many cycles, and this many response times of the stage."""
TURNED: Final = 0.002
"""A drive that moves back by this share of its range has turned: a new stride begins."""
AGAINST: Final = 0.005
"""A stride is wrong if the position moves by this share of its range against the drive."""
WRONG_STRIDES: Final = 3
"""This many wrong strides in a row are a fault."""


class FollowWatch:
    """Watches whether one axis follows its drive. Fixed memory. Real-time safe.

    Args:
        plausible: The widest loop; None if there is no model.
        window_cycles: Response time of the stage, in cycles.
        period_ns: Period of the loop, in ns.
    """

    def __init__(
        self,
        plausible: Plausible | None,
        window_cycles: int,
        period_ns: int,
    ) -> None:
        self._plausible = plausible
        self._limit_cycles = max(OUTSIDE_CYCLES, OUTSIDE_NS // period_ns)
        self._outside_cycles = 0
        self._strides = _Strides(max(STRIDE_CYCLES, STRIDE_ANSWERS * window_cycles))
        self.measured, self.limit = 0.0, MARGIN
        """Last distance beyond the widest loop, or against the drive, and its limit; in units of
        the range."""

    def update(self, position: float, drive: float, recent_v: RecentRange, noise: float) -> bool:
        """Take the position of a cycle; return whether it is implausible. Call once per cycle.

        Args:
            position: Credible position, in units of its range.
            drive: Voltage in force, in units of its range.
            recent_v: The voltages in force during the response time.
            noise: Standard deviation of the noise of the position, in units of the range.
        """
        against = self._strides.update(position, drive, noise)
        if self._plausible is not None:
            # Any drive of the response time may explain the position, so take the range over all of
            # them.
            low, high = self._plausible.low(recent_v.low), self._plausible.high(recent_v.high)
            beyond = max(low - position, position - high)
            if beyond <= MARGIN:
                # Leave twice as fast as enter: noise at the limit never adds up to a fault.
                if self._outside_cycles:
                    self._outside_cycles = max(self._outside_cycles - 2, 0)
            else:
                self._outside_cycles = min(self._outside_cycles + 1, self._limit_cycles)
                self.measured, self.limit = beyond, MARGIN
            if self._outside_cycles >= self._limit_cycles:
                return True
        if against:
            self.measured, self.limit = self._strides.against, AGAINST
        return against

    def forget(self) -> None:
        """Start again: the stage is not driven."""
        self._outside_cycles = 0
        self._strides.forget()


class _Strides:
    """Compares the directions of drive and position, stride by stride.

    Args:
        cycles: Shortest duration of a stride.
    """

    def __init__(self, cycles: int) -> None:
        self._min_cycles = cycles
        self.against = 0.0
        """Distance of the last wrong stride against the drive, in units of the range."""
        self.forget()

    def forget(self) -> None:
        """Start again."""
        self._cycles = -1
        self._wrong_strides = 0
        self._start_drive = self._start = self._farthest = 0.0

    def update(self, position: float, drive: float, noise: float) -> bool:
        """Take a cycle; return whether the last strides were wrong."""
        moved = drive - self._start_drive
        way, farthest = abs(moved), abs(self._farthest)
        # A turn back, or across the start of the stride.
        turned = way < farthest - TURNED or moved * self._farthest < 0.0
        rests = self._cycles >= self._min_cycles and farthest < TURNED
        if turned or rests or self._cycles < 0:  # at rest, creep may go either way
            self._begin(position, drive)
            return self._wrong_strides >= WRONG_STRIDES
        self._cycles += 1
        if way > farthest:
            self._farthest = moved
        if way >= STRIDE and self._cycles >= self._min_cycles:
            along = copysign(1.0, moved) * (position - self._start)
            # Both ends of the stride have noise: each may be off by four standard deviations.
            if along < -(AGAINST + 8.0 * noise):
                self._wrong_strides, self.against = (
                    min(self._wrong_strides + 1, WRONG_STRIDES),
                    -along,
                )
            else:
                self._wrong_strides = 0
            self._begin(position, drive)
        return self._wrong_strides >= WRONG_STRIDES

    def _begin(self, position: float, drive: float) -> None:
        """Begin a stride here."""
        self._cycles, self._farthest = 0, 0.0
        self._start_drive, self._start = drive, position
