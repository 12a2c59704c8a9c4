"""The newest setpoint of each axis, from the supervisor to the loop; it replaces older ones."""

from typing import NamedTuple

from piezod.telemetry.layout import STREAM_WORDS
from piezod.telemetry.shared_map import SharedMap


class StreamedSetpoint(NamedTuple):
    """A setpoint of a stream."""

    axis: int
    position_um: float
    t_ns: int


class StreamWriter:
    """End of the supervisor.

    Args:
        shared: The memory, writable; it has one writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        part = shared.part("streams")
        self._words, self._values = part.cast("q"), part.cast("d")

    def set(self, axis: int, position_um: float, t_ns: int) -> None:
        """Publish a setpoint for the next cycle, in µm; `t_ns` is its arrival."""
        at = axis * STREAM_WORDS
        # The count is written before and after the values; a reader takes them if both are equal.
        count = self._words[at] + 1
        self._words[at] = count
        self._values[at + 1] = position_um
        self._words[at + 2] = t_ns
        self._words[at + 3] = count


class StreamReader:
    """End of the loop."""

    def __init__(self, shared: SharedMap) -> None:
        part = shared.part("streams")
        self._words, self._values = part.cast("q"), part.cast("d")
        self._last_counts = [0] * len(shared.layout.axes)

    def take(self) -> list[StreamedSetpoint]:
        """Return the setpoints that are new since the last call. Real-time safe.

        A setpoint that is being written comes with the next call.
        """
        words, new = self._words, []
        for axis, last_count in enumerate(self._last_counts):
            at = axis * STREAM_WORDS
            count = words[at + 3]
            if count != last_count:
                setpoint = StreamedSetpoint(axis, self._values[at + 1], words[at + 2])
                if words[at] == count:
                    self._last_counts[axis] = count
                    new.append(setpoint)
        return new
