"""Waveforms along a path: points joined by straight lines, or levels one after the other.

The loop gets each as arrays of doubles, which it takes over with one copy.
"""

import random
from abc import abstractmethod
from array import array
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import Field, PrivateAttr, model_validator

from piezod.config.fields import BrokenRule, Quantity, raise_rules
from piezod.config.files import ExistingFile, Point, read_points
from piezod.config.quantities import DurationS, Level, Seed, Size, TimeS
from piezod.config.waveforms.waveform import (
    Budget,
    Packed,
    Swinging,
    Waveform,
    WaveformModel,
)
from piezod.errors import DataError

# A path with more turning points per second is noise.
MAX_TURNS_PER_S: Final = 200
Corners: TypeAlias = tuple[Sequence[float], Sequence[float]]
"""Times in s and levels; one time less if each level is held until the next."""
SpeedPerS: TypeAlias = Annotated[float, Quantity(1e-6, 1e6, "per s")]


class OnPath(WaveformModel):
    """A waveform that becomes a path for the loop."""

    kind: str

    @abstractmethod
    def corners(self, duration_s: float, most_points: float) -> Corners:
        """Return the times and the levels of the path.

        Args:
            duration_s: Longest time that will be evaluated, in s.
            most_points: As many levels are enough.
        """

    def span(self, levels: Sequence[float]) -> tuple[float, float]:
        """Return the lowest and the highest of all levels."""
        return min(levels), max(levels)

    def packed(self, duration_s: float, budget: Budget) -> Packed:
        """Return the path as arrays of doubles, as far as it will be evaluated."""
        times_s, levels = self.corners(duration_s, budget.points + 1)
        budget.take(terms=1, points=len(levels))
        times, values = (array("d", each).tobytes() for each in (times_s, levels))
        return {"kind": self.kind, "times_s": times, "levels": values, "span": self.span(levels)}

    @classmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the value along the path; before and after it the value is constant.

        Raises:
            ValueError: If the bytes are no doubles.
        """
        times_s, levels = array("d"), array("d")
        times_s.frombytes(packed["times_s"])
        levels.frombytes(packed["levels"])
        low, high = packed["span"]
        if len(times_s) < len(levels):
            return Waveform(lambda t_s: levels[bisect_right(times_s, t_s)], low, high, 0.0)
        last = len(times_s) - 1

        def value(t_s: float) -> float:
            index = bisect_right(times_s, t_s) - 1
            if index < 0:
                return levels[0]
            if index == last:
                return levels[-1]
            start_s, start, end = times_s[index], levels[index], levels[index + 1]
            level = start + (end - start) / (times_s[index + 1] - start_s) * (t_s - start_s)
            # Rounding may carry the last bit beyond the end of the line.
            return min(max(level, min(start, end)), max(start, end))

        return Waveform(value, low, high, 0.0)


class Staircase(OnPath):
    """Levels one after the other; the last level is held."""

    kind: Literal["staircase"]
    levels: tuple[Level, ...] = Field(min_length=1, max_length=10_000, description="The levels.")
    dwell_s: DurationS = Field(description="Duration of each level, s.")

    def corners(self, duration_s: float, most_points: float) -> Corners:  # noqa: ARG002 - all
        """Return all levels, and the times between them."""
        return [self.dwell_s * count for count in range(1, len(self.levels))], self.levels


class Reversals(Swinging, OnPath):
    """Straight lines between random turning points; the seed determines them."""

    kind: Literal["reversals"]
    min_swing: Size = Field(description="Smallest distance between two turning points.")
    min_speed: SpeedPerS = Field(description="Lowest speed, per s.")
    max_speed: SpeedPerS = Field(description="Highest speed, per s.")
    seed: Seed = Field(description="Seed of turning points and speeds.")

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        raise_rules(self._broken_sizes())
        return self

    def _broken_sizes(self) -> Iterator[BrokenRule]:
        span, fastest = self.high - self.low, self.min_swing * MAX_TURNS_PER_S
        if self.min_swing > span:
            what = f"longer than the range (got {self.min_swing:g}), allowed: at most {span:g}"
            yield ("min_swing",), what
        if self.max_speed < self.min_speed:
            what = f"below min_speed (got {self.max_speed:g}), allowed: at least {self.min_speed:g}"
            yield ("max_speed",), what
        if self.max_speed > fastest:
            what = f"more than {MAX_TURNS_PER_S} times min_swing per s (got {self.max_speed:g})"
            yield ("max_speed",), f"{what}, allowed: at most {fastest:g}"

    def span(self, levels: Sequence[float]) -> tuple[float, float]:  # noqa: ARG002 - or further
        """Return the range, which a path need not reach."""
        return self.low, self.high

    def corners(self, duration_s: float, most_points: float = inf) -> Corners:
        """Return the turning points of a path that starts at its lowest level and rises.

        A longer path continues a shorter one of the same seed.

        Args:
            duration_s: The path ends at the first turning point at or after this time, in s.
            most_points: The path ends after this many turning points at the latest.
        """
        # `random` draws the same values on every machine and in every version of Python; numpy does
        # not promise that.
        draws = random.Random(self.seed)  # noqa: S311 - reproducible, not secret
        t_s, level, rising = 0.0, self.low, True
        times_s, levels = [t_s], [level]
        while t_s < duration_s and len(levels) < most_points:
            # After a swing of at least min_swing there is room for one in the other direction.
            room = self.high - level if rising else level - self.low
            swing = self.min_swing + (room - self.min_swing) * draws.random()
            speed = self.min_speed + (self.max_speed - self.min_speed) * draws.random()
            level += swing if rising else -swing
            level = min(max(level, self.low), self.high)
            t_s += swing / speed
            rising = not rising
            times_s.append(t_s)
            levels.append(level)
        return times_s, levels


class Lines(OnPath):
    """Points joined by straight lines; the first and the last value are held."""

    @abstractmethod
    def line(self) -> tuple[Point, ...]:
        """Return pairs of time in s and value, times increasing."""

    def begin_and_end_s(self) -> tuple[float, float]:
        """Return when the only period begins and ends, in s."""
        return self.line()[0][0], self.line()[-1][0]

    def broken_period(self) -> Iterator[BrokenRule]:
        """Yield why it does not repeat."""
        (begin_s, begin), (end_s, end) = self.line()[0], self.line()[-1]
        if not end_s > begin_s:
            yield (), "needs points at two times at least"
        elif begin != end:
            yield (), f"ends at {end:g} µm and begins at {begin:g} µm: close the period"

    def corners(self, duration_s: float, most_points: float) -> Corners:  # noqa: ARG002 - all
        """Return all points."""
        times_s, levels = zip(*self.line(), strict=True)
        return times_s, levels


class Points(Lines):
    """Points joined by straight lines; the first and the last value are held."""

    kind: Literal["points"]
    points: tuple[tuple[TimeS, Level], ...] = Field(
        min_length=1,
        max_length=10_000,
        description="Pairs of time in s and value, times increasing.",
    )

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        for index, ((before_s, _), (time_s, _)) in enumerate(pairwise(self.points), start=1):
            if not before_s < time_s:
                what = f"must be later than the point before it (got {time_s:g} s)"
                raise_rules([(("points", index), what)])
        return self

    def line(self) -> tuple[Point, ...]:
        """Return the points."""
        return self.points

    def slowed(self, factor: float) -> Self:
        """Return the points, so many times later."""
        later = tuple((t_s * factor, level) for t_s, level in self.points)
        return self.model_copy(update={"points": later})


class Csv(Lines):
    """Points from a file, joined by straight lines; the first and the last value are held."""

    kind: Literal["csv"]
    path: ExistingFile = Field(description="Table with time and values, relative to this file.")
    column: str = Field(
        description="Column with the values; the times are in a column such as t_s or Time (ms)."
    )
    _points: tuple[Point, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _read(self) -> Self:
        try:
            # Read here and not in the run: the points are checked, and the file may change later.
            self._points = read_points(self.path, self.column)
        except ValueError as error:
            raise_rules([(("path",), str(error))])
        return self

    def line(self) -> tuple[Point, ...]:
        """Return the points, as read when this was made."""
        return self._points

    def sendable(self) -> Points:
        """Return the points.

        Raises:
            ValidationError: If the file has more points than may be sent.
        """
        return Points(kind="points", points=self._points)

    def slowed(self, factor: float) -> Self:
        """Raise a DataError: its times are in the file."""
        raise DataError(f"the times of a CSV file cannot be slowed down {factor:.3g} times")


AnyLines: TypeAlias = Points | Csv
AnyPath: TypeAlias = Staircase | Reversals | AnyLines
"""Every waveform of this file."""
