"""A ring of records, without a loop."""

from collections.abc import Mapping, Sequence
from threading import Lock
from typing import Any

from numpy.typing import NDArray

from piezod.daemon.stores.recorded_files import RecordedStage
from piezod.telemetry.learned import LearnedAxis
from piezod.telemetry.record import StageEvent
from tests.records.telemetry import record_dtype, records


class FakeRing:
    """Holds the newest records, up to its capacity; a reader begins with the next record."""

    def __init__(self, capacity: int = 100_000) -> None:
        self._capacity = capacity
        self._lock = Lock()
        self.newest = 0
        self.weights: dict[str, Sequence[float]] = {"x": [1.0, 2.0], "y": [3.0]}
        self.surfaces: set[str] = set()
        self.models: dict[str, str] = {}
        self.events: list[StageEvent] = []
        self.high = range(0)
        """Cycles in which its line is high."""

    @property
    def stage(self) -> RecordedStage:
        """What a recorder reads."""
        return RecordedStage(
            self.open_reader,
            lambda: FakeEvents(self.events),
            record_dtype,
            self.learned,
            lambda: self.models,
            self.last,
        )

    def records(self, begin: int, end: int) -> NDArray[Any]:
        """Return records, with the levels of the only line."""
        found = records(begin, end)
        found["lines"] = [number in self.high for number in range(begin, end)]
        return found

    def learned(self) -> Mapping[str, LearnedAxis]:
        """Return the parameters of the axes."""
        return {
            axis: LearnedAxis(weights, 0.0, 1.0, 0.0, axis in self.surfaces, 0.0, 0.0, 26.0)
            for axis, weights in self.weights.items()
        }

    def run(self, cycles: int) -> None:
        """Append the records of some cycles."""
        with self._lock:
            self.newest += cycles

    def open_reader(self) -> "FakeReader":
        """Return a reader."""
        return FakeReader(self)

    def last(self, count: int) -> NDArray[Any]:
        """Return the newest records, at most `count`."""
        return self.records(max(0, self.newest - min(count, self._capacity)), self.newest)

    def oldest(self) -> int:
        """Return the number of the oldest record that is left."""
        return max(0, self.newest - self._capacity)


class FakeReader:
    """Reads the records since its last call."""

    def __init__(self, ring: FakeRing) -> None:
        self._ring, self.position = ring, ring.newest

    def read(self, limit: int) -> tuple[NDArray[Any], int]:
        begin = max(self.position, self._ring.oldest())
        end = min(begin + limit, self._ring.newest)
        lost = begin - self.position
        self.position = end
        return self._ring.records(begin, end), lost


class FakeEvents:
    """Reads the events since its last call."""

    def __init__(self, events: list[StageEvent]) -> None:
        self._events, self._position = events, len(events)

    def read(self) -> tuple[list[StageEvent], int]:
        found = self._events[self._position :]
        self._position += len(found)
        return found, 0


class EndlessReader:
    """Returns a thousand records at each call."""

    def __init__(self) -> None:
        self._position = 0

    def read(self, limit: int) -> tuple[NDArray[Any], int]:
        begin = self._position
        self._position += min(limit, 1000)
        return records(begin, self._position), 0
