"""Answers of a daemon, typed. An unknown number is None, because JSON has no NaN.

Every result keeps the complete `document`: a newer daemon may report more than these fields.
"""

from dataclasses import dataclass, field
from typing import Any, TypeAlias

from piezod.messages.notebook import StatusTable

Document: TypeAlias = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Result:
    """Base of all answers.

    Attributes:
        document: The complete answer; left out of the printed form, which has its fields.
    """

    document: Document = field(repr=False)


@dataclass(frozen=True, kw_only=True)
class Answer(Result):
    """A request that the loop has accepted.

    Attributes:
        motion: Number of the movement that it started, 0 if it started none.
        state: State of the stage then, one of `piezod.config.states.State`.
    """

    motion: int = 0
    state: str = ""


@dataclass(frozen=True, kw_only=True)
class StreamEnd(Result):
    """A stream of setpoints that has ended.

    Attributes:
        setpoints: Number of setpoints.
    """

    setpoints: int


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault that is present or latched.

    Attributes:
        id: Id in docs/faults.md, for example "S5".
        name: Short description.
        severity: "info", "warning" or "error"; an older daemon does not report it.
        present: Whether the fault is present now.
        latched: Whether the fault stays until it is reset.
        remedy: What the user can do.
    """

    id: str
    name: str = ""
    severity: str = "error"
    present: bool = True
    latched: bool = False
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class AxisStatus:
    """One axis in the newest cycle.

    Attributes:
        position_um: Measured position, in µm; None without a sensor.
        command_um: Commanded position, in µm.
        drive_v: Drive voltage, in V.
        target_um: Target of the movement, in µm.
        mode: Mode of the compensator.
        on_target: Whether the position has been within its tolerance for the settling time.
        motion: Number of the movement.
        has_sensor: Whether a sensor measures the axis.
        limited: What limits the drive: `none`, `range` or `slew rate`.
    """

    position_um: float | None
    command_um: float | None
    drive_v: float | None
    target_um: float | None = None
    mode: str = ""
    on_target: bool = False
    motion: int = 0
    has_sensor: bool = True
    limited: str = "none"

    @property
    def error_um(self) -> float | None:
        """Command minus position, in µm; None if one of them is unknown."""
        if self.command_um is None or self.position_um is None:
            return None
        return self.command_um - self.position_um


@dataclass(frozen=True, kw_only=True)
class Processor:
    """The processor of a loop.

    Attributes:
        number: Its number.
        shared_with: Number of loops of other stages that had it when this one started.
    """

    number: int
    shared_with: int = 0


@dataclass(frozen=True, kw_only=True)
class Status(Result, StatusTable):
    """A stage in its newest cycle.

    Attributes:
        state: One of `piezod.config.states.State`.
        shadow: Whether the stage is in shadow mode: everything is computed, nothing written.
        mode: Mode of all axes; "mixed" if they differ.
        faults: Faults that are present or latched.
        skipped_cycles: Number of skipped cycles since the loop started.
        axes: Axes by name.
        stage: Name of the stage.
        title: Title of the stage, for people.
        rate_hz: Configured cycles per second; None if the daemon does not report it.
        processor: Processor of the loop; None if the loop has none of its own choice.
        role: Role of this client: viewer, operator or engineer; empty if the daemon does not tell.
    """

    state: str
    mode: str
    faults: tuple[Fault, ...]
    skipped_cycles: int
    axes: dict[str, AxisStatus]
    shadow: bool = False
    stage: str = ""
    title: str = ""
    rate_hz: float | None = None
    processor: Processor | None = None
    role: str = ""


@dataclass(frozen=True, kw_only=True)
class Health(Result):
    """The health of the loop.

    Attributes:
        healthy: Whether the loop runs cycles; `document` has the measured values.
    """

    healthy: bool


@dataclass(frozen=True, kw_only=True)
class Faults(Result):
    """Faults that are present or latched.

    Attributes:
        faults: The faults.
    """

    faults: tuple[Fault, ...]


@dataclass(frozen=True, kw_only=True)
class Reloaded(Result):
    """A configuration that has been read again and is in force.

    Attributes:
        changes: Paths of the values that have changed, for example "axes.x.speed_um_per_s".
        lost: What has been lost of the parameters in use, each with its remedy; usually nothing.
    """

    changes: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Parameters(Result):
    """The parameters in use.

    Attributes:
        axes: Parameters of each axis, by the name of the axis, with the keys of the daemon.
        sequence: Number under which they were saved last, None if they were never saved.
    """

    axes: dict[str, Document]
    sequence: int | None = None


@dataclass(frozen=True, kw_only=True)
class Saved(Result):
    """Saved parameters.

    Attributes:
        sequence: Their number, larger for later ones.
    """

    sequence: int


@dataclass(frozen=True, kw_only=True)
class HistoryEntry:
    """Saved parameters in the history.

    Attributes:
        sequence: Their number.
        saved_at: Time, ISO 8601.
        saved_by: User.
        axes: Names of the axes.
        why: Why they cannot be used; empty if they can.
    """

    sequence: int
    saved_at: str = ""
    saved_by: str = ""
    axes: tuple[str, ...] = ()
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class History(Result):
    """All saved parameters.

    Attributes:
        history: Newest first.
    """

    history: tuple[HistoryEntry, ...]


@dataclass(frozen=True, kw_only=True)
class RecordingFile:
    """A finished recording, or the one in progress.

    Attributes:
        name: Name, from the daemon.
        size_bytes: Size in bytes, None while in progress.
        records: Number of recorded cycles, None if finished.
        lost: Number of lost cycles, None if finished.
        kept: Whether it stays when old recordings are removed, None while in progress.
        files: Number of files of a recording in progress, None if finished.
    """

    name: str
    size_bytes: int | None = None
    records: int | None = None
    lost: int | None = None
    kept: bool | None = None
    files: int | None = None


@dataclass(frozen=True, kw_only=True)
class Recording(Result):
    """A recording that was started or ended.

    Attributes:
        name: Name.
        records: Number of recorded cycles.
        lost: Number of lost cycles.
        why: Why it ended by itself; empty if it did not.
        files: Number of its files; the names of all but the first one end in their number.
    """

    name: str
    records: int = 0
    lost: int = 0
    why: str = ""
    files: int = 1


@dataclass(frozen=True, kw_only=True)
class KeptRecording(Result):
    """A recording that was marked, or whose mark was removed.

    Attributes:
        name: Name.
        kept: Whether it is marked as kept.
    """

    name: str
    kept: bool


@dataclass(frozen=True, kw_only=True)
class Recordings(Result):
    """All recordings.

    Attributes:
        running: The recording in progress, None if there is none.
        recordings: The finished recordings.
    """

    running: RecordingFile | None
    recordings: tuple[RecordingFile, ...]
