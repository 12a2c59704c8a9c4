"""The newest setpoint of each axis, from the supervisor to the loop; older ones are overwritten."""

from typing import NamedTuple

from piezod.telemetry.layout import STREAM_WORDS
from piezod.telemetry.shared_map import SharedMap


class StreamedSetpoint(NamedTuple):
    """A position that a stream asks for."""

    axis: int
    position_um: float
    t_ns: int


class StreamWriter:
    """The supervisor's end.

    Args:
        shared: The memory, writable; there is one writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        part = shared.part("streams")
        self._words, self._values = part.cast("q"), part.cast("d")

    def set(self, axis: int, position_um: float, t_ns: int) -> None:
        """Leave a setpoint for the next cycle, in µm; `t_ns` is when it came."""
        at = axis * STREAM_WORDS
        count = self._words[at] + 1
        self._words[at] = count
        self._values[at + 1] = position_um
        self._words[at + 2] = t_ns
        self._words[at + 3] = count


class StreamReader:
    """The loop's end.

    Args:
        shared: The memory.
    """

    def __init__(self, shared: SharedMap) -> None:
        part = shared.part("streams")
        self._words, self._values = part.cast("q"), part.cast("d")
        self._seen = [0] * len(shared.layout.axes)

    def take(self) -> list[StreamedSetpoint]:
        """Return what is new since the last call; may be called in the loop.

        A setpoint that is just being written comes with the next call.
        """
        words, fresh = self._words, []
        for axis, seen in enumerate(self._seen):
            at = axis * STREAM_WORDS
            count = words[at + 3]
            if count != seen:
                setpoint = StreamedSetpoint(axis, self._values[at + 1], words[at + 2])
                if words[at] == count:
                    self._seen[axis] = count
                    fresh.append(setpoint)
        return fresh
