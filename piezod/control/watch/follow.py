"""Whether a displacement follows the drive at all: S9, by two tests that no adaptation can fool.

Where there is a model, a stage is between the branches of its widest loop, whatever its past. With
or without one it goes up when the drive goes up, once a stride is long enough to tell.
"""

from math import copysign
from typing import Final

import numpy as np

from piezod.control.law.model import StageModel
from piezod.control.signals import RecentRange
from piezod.units import NS_PER_S

_POINTS = 65


class Plausible:
    """The widest loop of an identified stage, as a table; independent of what is learned later.

    Args:
        model: The identified model.
    """

    def __init__(self, model: StageModel) -> None:
        rise = np.linspace(0.0, 1.0, 513)
        drives = model.inverse().run(np.concatenate((rise, rise[::-1])))
        grid = np.linspace(0.0, 1.0, _POINTS)
        up = np.maximum.accumulate(drives[: rise.size])
        down = np.maximum.accumulate(drives[rise.size :][::-1])
        one, other = np.interp(grid, up, rise), np.interp(grid, down, rise)
        self._low: list[float] = np.minimum(one, other).tolist()
        self._high: list[float] = np.maximum(one, other).tolist()
        self._drive_v = model.drive_v

    def bounds(self, low_v: float, high_v: float) -> tuple[float, float]:
        """Return between what a stage is while its drive is between two finite voltages.

        May be called in the loop.

        Returns:
            Lowest and highest displacement without creep, in units of the model's range.
        """
        return self._at(low_v, self._low), self._at(high_v, self._high)

    def _at(self, drive_v: float, table: list[float]) -> float:
        place = min(max(self._drive_v.to_unit(drive_v), 0.0), 1.0) * (_POINTS - 1)
        index = min(int(place), _POINTS - 2)
        return table[index] + (table[index + 1] - table[index]) * (place - index)


MARGIN: Final = 0.1
"""So far beyond the widest loop, in parts of the range, creep, drift and a load may take a stage;
an offset of the sensor or a wrong gain takes it farther."""
OUTSIDE_CYCLES: Final = 20
OUTSIDE_NS: Final = NS_PER_S // 100
"""It is implausible after the longer of the two, less what rings back in between."""
STRIDE: Final = 0.02
"""Part of the drive's range that a stride has at least."""
STRIDE_CYCLES: Final = 20
STRIDE_WINDOWS: Final = 4
"""A stride lasts so many cycles and so many times what the stage takes to answer."""
TURNED: Final = 0.002
"""A drive that goes back by this part of its range has turned: a new stride begins."""
AGAINST: Final = 0.005
"""A stage that moves by this part of its range against the drive makes a wrong stride."""
WRONG_STRIDES: Final = 3


class FollowWatch:
    """Watches one axis; fixed memory.

    Args:
        plausible: The widest loop, None where it is not known.
        window_cycles: What the stage takes to answer, in cycles.
        period_ns: Period of the loop.
    """

    def __init__(
        self,
        plausible: Plausible | None,
        window_cycles: int,
        period_ns: int,
    ) -> None:
        self._plausible = plausible
        self._enough = max(OUTSIDE_CYCLES, OUTSIDE_NS // period_ns)
        self._outside = 0
        self._strides = _Strides(max(STRIDE_CYCLES, STRIDE_WINDOWS * window_cycles))
        self.measured, self.limit = 0.0, MARGIN
        """How far beyond the widest loop it was last, or against the drive, in units of the range;
        and what would have been allowed."""

    def update(self, position: float, drive: float, recent_v: RecentRange, noise: float) -> bool:
        """Take a credible displacement; return whether it is implausible; call it in the loop.

        Args:
            position: Displacement, in units of its range.
            drive: Drive in force, in units of its range.
            recent_v: The voltages in force while the stage answered.
            noise: Standard deviation of the displacement's noise, in units of the range.
        """
        against = self._strides.update(position, drive, noise)
        if self._plausible is not None:
            low, high = self._plausible.bounds(recent_v.low, recent_v.high)
            beyond = max(low - position, position - high)
            if beyond <= MARGIN:
                self._outside = max(self._outside - 2, 0)
            else:
                self._outside = min(self._outside + 1, self._enough)
                self.measured, self.limit = beyond, MARGIN
            if self._outside >= self._enough:
                return True
        if against:
            self.measured, self.limit = self._strides.against, AGAINST
        return against

    def forget(self) -> None:
        """Begin anew: the stage is not driven; may be called in the loop."""
        self._outside = 0
        self._strides.forget()


class _Strides:
    """Compares which way drive and displacement go, stride by stride.

    Args:
        cycles: How long a stride lasts at least.
    """

    def __init__(self, cycles: int) -> None:
        self._least_cycles = cycles
        self.against = 0.0
        """How far the last wrong stride went against the drive, in units of the range."""
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._cycles = -1
        self._wrong = 0
        self._start_drive = self._start = self._farthest = 0.0

    def update(self, position: float, drive: float, noise: float) -> bool:
        """Take a cycle; return whether several strides in a row went wrong."""
        moved = drive - self._start_drive
        turned = abs(moved) < abs(self._farthest) - TURNED or moved * self._farthest < 0.0
        rests = self._cycles >= self._least_cycles and abs(self._farthest) < TURNED
        if self._cycles < 0 or turned or rests:  # at rest it creeps, either way
            self._begin(position, drive)
            return self._wrong >= WRONG_STRIDES
        self._cycles += 1
        if abs(moved) > abs(self._farthest):
            self._farthest = moved
        if self._cycles >= self._least_cycles and abs(moved) >= STRIDE:
            along = copysign(1.0, moved) * (position - self._start)
            # Both ends have noise: each may be off by four standard deviations.
            if along < -(AGAINST + 8.0 * noise):
                self._wrong, self.against = min(self._wrong + 1, WRONG_STRIDES), -along
            else:
                self._wrong = 0
            self._begin(position, drive)
        return self._wrong >= WRONG_STRIDES

    def _begin(self, position: float, drive: float) -> None:
        self._cycles, self._farthest = 0, 0.0
        self._start_drive, self._start = drive, position
