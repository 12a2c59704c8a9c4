"""What is in a recording, in a few numbers; any length is read in portions."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, sqrt
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezod.records.frozen import FloatArray
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.marks import LATE_PART
from piezod.records.recording.reader import RecordedTelemetry, read_portions
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S

_COLUMNS: Final = frozenset(
    {
        *("t_s", "late_ns", "skipped", "state", "present_lo", "present_hi"),
        *("mode", "position_um", "command_um"),
    }
)
_RUN: Final = "RUN"


class ModeErrors(NamedTuple):
    """Errors of an axis in a mode, over the cycles in RUN with a valid sample and a command."""

    axis: str  #: Name of the axis.
    mode: str  #: Name of the mode.
    duration_s: float  #: Time, in s.
    rms_um: float  #: Rms error, in µm.
    worst_um: float  #: Largest error, in µm.


class FaultTime(NamedTuple):
    """A fault that was present."""

    fault: str  #: Its id.
    cycles: int  #: Number of cycles in which it was present.
    first_s: float  #: Instant of the first of them, in s.
    last_s: float  #: Instant of the last of them, in s.


class UsedModel(NamedTuple):
    """A model of an axis."""

    axis: str  #: Name of the axis.
    since_s: float  #: Instant from which it was in use, in s; NaN for the start of the file.
    text: str  #: Text of its file.


@dataclass(frozen=True)
class Summary:
    """What is in a recording."""

    header: TelemetryHeader  #: Header of the file.
    begin_s: float  #: Instant of the first cycle, in s; NaN without one.
    end_s: float  #: Instant of the last cycle, in s.
    cycles: int  #: Number of cycles.
    late: int  #: Number of cycles that began later than half a period.
    skipped: int  #: Number of periods that the loop skipped.
    lost: int  #: Number of cycles that ran and are not in the file.
    invalid: dict[str, int]  #: Number of invalid samples of each axis.
    states: dict[str, float]  #: Time in each state, in s.
    errors: tuple[ModeErrors, ...]  #: Errors of each axis in each mode.
    faults: tuple[FaultTime, ...]  #: Faults that were present, in the order of their begin.
    models: tuple[UsedModel, ...]  #: Models of the axes, those of the start first.
    events: tuple[StageEvent, ...]  #: The log of the loop.


def summary_of(path: Path) -> Summary:
    """Return what is in a recording; it may still be in progress.

    Raises:
        DataError: If the file is not a recording of a stage.
        OSError: If the file cannot be opened.
    """
    counts = _Counts()
    for portion in read_portions(path, columns=_COLUMNS):
        counts.add(portion)
    header = portion.header
    start = [UsedModel(axis, nan, header.notes.get(f"model_{axis}", "")) for axis in header.axes]
    adopted = [
        UsedModel(each.axis, (each.t_ns - header.start_ns) / NS_PER_S, each.text)
        for each in portion.adopted
    ]
    return Summary(
        header=header,
        begin_s=counts.begin_s,
        end_s=counts.end_s,
        cycles=counts.cycles,
        late=counts.late,
        skipped=counts.skipped,
        lost=portion.lost,
        invalid=counts.invalid,
        states={name: count / header.rate_hz for name, count in counts.states.items()},
        errors=tuple(
            ModeErrors(*key, each.cycles / header.rate_hz, each.rms, each.worst)
            for key, each in counts.errors.items()
        ),
        faults=tuple(counts.faults.values()),
        models=(*(each for each in start if each.text), *adopted),
        events=portion.events,
    )


@dataclass
class _Error:
    """Sums over the cycles of an axis in a mode."""

    cycles: int = 0
    squares: float = 0.0
    worst: float = 0.0

    @property
    def rms(self) -> float:
        return sqrt(self.squares / self.cycles)

    def add(self, errors_um: NDArray[np.float64]) -> None:
        self.cycles += errors_um.size
        self.squares += float(np.sum(errors_um**2))
        self.worst = max(self.worst, float(np.max(np.abs(errors_um))))


class _Counts:
    """Sums over the portions of a recording."""

    def __init__(self) -> None:
        self.begin_s = self.end_s = nan
        self.cycles = self.late = self.skipped = 0
        self.invalid: dict[str, int] = {}
        self.states: dict[str, int] = {}
        self.errors: dict[tuple[str, str], _Error] = {}
        self.faults: dict[str, FaultTime] = {}
        self._skipped_before: int | None = None

    def add(self, portion: RecordedTelemetry) -> None:
        """Add a portion, which may be empty."""
        cycles, header = portion.cycles, portion.header
        t_s = cycles["t_s"]
        if not t_s.size:
            return
        self.begin_s = float(t_s[0]) if not self.cycles else self.begin_s
        self.end_s = float(t_s[-1])
        self.cycles += t_s.size
        self.late += int(np.sum(cycles["late_ns"] * header.rate_hz > LATE_PART * NS_PER_S))
        self._add_skipped(cycles["skipped"])
        for number, count in zip(*np.unique(cycles["state"], return_counts=True), strict=True):
            name = header.names["state"][number]
            self.states[name] = self.states.get(name, 0) + int(count)
        for axis in header.axes:
            self._add_errors(portion, axis)
        for mask, bits in header.bits.items():
            if mask.startswith("present"):
                self._add_faults(t_s, cycles[mask], bits)

    def _add_skipped(self, skipped: NDArray[np.int64]) -> None:
        before = int(skipped[0]) if self._skipped_before is None else self._skipped_before
        self._skipped_before = int(skipped[-1])
        self.skipped += self._skipped_before - before

    def _add_errors(self, portion: RecordedTelemetry, axis: str) -> None:
        names, columns = portion.header.names, portion.axes[axis]
        position_um, modes = columns["position_um"], columns["mode"]
        invalid = int(np.count_nonzero(~np.isfinite(position_um)))
        self.invalid[axis] = self.invalid.get(axis, 0) + invalid
        error_um = columns["command_um"] - position_um
        states = list(names["state"])
        running = portion.cycles["state"] == (states.index(_RUN) if _RUN in states else -1)
        judged = running & np.isfinite(error_um)
        for number in np.unique(modes[judged]):
            total = self.errors.setdefault((axis, names["mode"][number]), _Error())
            total.add(error_um[judged & (modes == number)])

    def _add_faults(self, t_s: FloatArray, mask: NDArray[np.uint64], bits: Sequence[str]) -> None:
        seen = int(np.bitwise_or.reduce(mask))
        for place, fault in enumerate(bits):
            if seen >> place & 1:
                (rows,) = np.nonzero(mask >> np.uint64(place) & np.uint64(1))
                first_s, last_s = float(t_s[rows[0]]), float(t_s[rows[-1]])
                before = self.faults.get(fault, FaultTime(fault, 0, first_s, last_s))
                self.faults[fault] = before._replace(
                    cycles=before.cycles + rows.size, last_s=last_s
                )
