"""What a daemon tells all the time: server-sent events, each of one interval of time."""

import json
from dataclasses import dataclass

from piezod.client.errors import unexpected
from piezod.client.results import Result, reader


@dataclass(frozen=True, kw_only=True)
class Range:
    """A quantity in one interval: no spike is lost, however slowly it is told.

    Attributes:
        min: Least value of all cycles.
        max: Largest value of all cycles.
        last: Value in the last cycle.
    """

    min: float | None
    max: float | None
    last: float | None


@dataclass(frozen=True, kw_only=True)
class AxisTelemetry:
    """One axis in one interval.

    Attributes:
        position_um: Measured displacement.
        command_um: Displacement asked for.
        drive_v: Voltage written.
        error_um: Command less position.
        target_um: Where the movement ends.
        mode: How the drive is made from the command.
        on_target: Whether the target had been reached in the last cycle, and held.
        motion: Number of the movement in the last cycle.
    """

    position_um: Range
    command_um: Range
    drive_v: Range
    error_um: Range
    target_um: float | None = None
    mode: str = ""
    on_target: bool = False
    motion: int = 0


@dataclass(frozen=True, kw_only=True)
class Telemetry(Result):
    """All axes in one interval.

    Attributes:
        t_s: Instant of the last cycle, s, on a clock of the daemon that never goes back.
        cycles: How many cycles the interval had.
        lost: How many more it had, which this client was too slow for.
        state: In the last cycle.
        shadow: Whether everything is computed and nothing written.
        faults: Ids of the faults that were present in any cycle or are latched.
        skipped_cycles: Cycles that the loop has missed since it started.
        axes: By name.
    """

    t_s: float
    cycles: int
    lost: int
    state: str
    shadow: bool = False
    faults: tuple[str, ...]
    skipped_cycles: int
    axes: dict[str, AxisTelemetry]


_read = reader(Telemetry)


class TelemetryReader:
    """Makes telemetry of the lines of an event stream."""

    def __init__(self) -> None:
        self._data: list[str] = []

    def feed(self, line: str) -> Telemetry | None:
        """Take the next line; return what it completes, if it does.

        Args:
            line: Without its end.

        Raises:
            ClientError: If the event is none that is known.
        """
        if line:
            name, _, value = line.partition(":")
            if name == "data":
                self._data.append(value.removeprefix(" "))
            return None
        text, self._data = "\n".join(self._data), []
        if not text:
            return None
        try:
            document = json.loads(text)
        except ValueError as error:
            raise unexpected(text, str(error)) from error
        if not isinstance(document, dict):
            raise unexpected(document, "must be an object")
        return _read(document)
