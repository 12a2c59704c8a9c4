"""What a daemon answers, typed. Numbers are None where there is none, as JSON has no NaN.

Every result keeps the daemon's whole `document`: a newer daemon may tell more than is named here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias, TypeVar

from piezod.client.errors import unexpected

if TYPE_CHECKING:
    from pydantic import TypeAdapter

Document: TypeAlias = dict[str, Any]
ResultT = TypeVar("ResultT", bound="Result")


@dataclass(frozen=True, kw_only=True)
class Result:
    """Base of everything that a daemon answers.

    Attributes:
        document: The answer as it came.
    """

    document: Document


@dataclass(frozen=True, kw_only=True)
class Answer(Result):
    """A request that is being carried out.

    Attributes:
        motion: Number of the movement that it started, 0 where it started none.
    """

    motion: int = 0


@dataclass(frozen=True, kw_only=True)
class StreamEnd(Result):
    """A stream of setpoints that has ended.

    Attributes:
        setpoints: How many there were.
    """

    setpoints: int


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault that is present, or was and is latched.

    Attributes:
        id: As in docs/faults.md, "S5".
        name: What it is, in a few words.
        present: Whether it is there now.
        latched: Whether it stays until it is reset.
        remedy: What to do about it.
    """

    id: str
    name: str = ""
    present: bool = True
    latched: bool = False
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class AxisStatus:
    """One axis in the newest cycle.

    Attributes:
        position_um: Measured displacement.
        command_um: Displacement asked for.
        drive_v: Voltage in force.
        target_um: Where the movement ends.
        mode: How the drive is made from the command.
        on_target: Whether the target has been reached, and held.
        motion: Number of the movement.
    """

    position_um: float | None
    command_um: float | None
    drive_v: float | None
    target_um: float | None = None
    mode: str = ""
    on_target: bool = False
    motion: int = 0

    @property
    def error_um(self) -> float | None:
        """The command less the position, None where one of them is missing."""
        if self.command_um is None or self.position_um is None:
            return None
        return self.command_um - self.position_um


@dataclass(frozen=True, kw_only=True)
class Status(Result):
    """A stage in its newest cycle.

    Attributes:
        state: One of `piezod.config.states.State`.
        shadow: Whether everything is computed and nothing written.
        mode: Of the only axis; "mixed" where axes differ.
        faults: What is present or latched.
        skipped_cycles: Cycles that the loop has missed since it started.
        axes: By name.
        stage: Name of the stage.
        title: What it is, for people.
    """

    state: str
    mode: str
    faults: tuple[Fault, ...]
    skipped_cycles: int
    axes: dict[str, AxisStatus]
    shadow: bool = False
    stage: str = ""
    title: str = ""


@dataclass(frozen=True, kw_only=True)
class Health(Result):
    """How the loop is.

    Attributes:
        healthy: Whether it runs on schedule; `document` has what tells so.
    """

    healthy: bool


@dataclass(frozen=True, kw_only=True)
class Faults(Result):
    """What is present or latched.

    Attributes:
        faults: The faults.
    """

    faults: tuple[Fault, ...]


@dataclass(frozen=True, kw_only=True)
class Parameters(Result):
    """The parameters that the loop uses now.

    Attributes:
        axes: By name: what belongs to the axis, as the daemon names it.
        sequence: Number under which they were saved last, None where they never were.
    """

    axes: dict[str, Document]
    sequence: int | None = None


@dataclass(frozen=True, kw_only=True)
class Saved(Result):
    """Parameters in the daemon's store.

    Attributes:
        sequence: Their number, larger for later ones.
    """

    sequence: int


@dataclass(frozen=True, kw_only=True)
class HistoryEntry:
    """Saved parameters in the history.

    Attributes:
        sequence: Their number.
        saved_at: When, ISO 8601.
        saved_by: By whom.
        axes: Of which axes.
        why: What is wrong with them; empty where they can be used.
    """

    sequence: int
    saved_at: str = ""
    saved_by: str = ""
    axes: tuple[str, ...] = ()
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class History(Result):
    """What is saved.

    Attributes:
        history: Newest first.
    """

    history: tuple[HistoryEntry, ...]


@dataclass(frozen=True, kw_only=True)
class RecordingFile:
    """A recording that is finished, or the one that is being made.

    Attributes:
        name: The daemon made it.
        size_bytes: Its size, None while it is being made.
        records: How many cycles are in it, None once it is finished.
        lost: How many are missing, likewise.
    """

    name: str
    size_bytes: int | None = None
    records: int | None = None
    lost: int | None = None


@dataclass(frozen=True, kw_only=True)
class Recording(Result):
    """A recording that was begun or ended.

    Attributes:
        name: Its name.
        records: How many cycles are in it.
        lost: How many are missing.
        why: Why it ended by itself; empty where it did not.
    """

    name: str
    records: int = 0
    lost: int = 0
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class Recordings(Result):
    """What is recorded.

    Attributes:
        running: The one that is being made, None where there is none.
        recordings: Those that are finished.
    """

    running: RecordingFile | None
    recordings: tuple[RecordingFile, ...]


def reader(result: type[ResultT]) -> Callable[[Document], ResultT]:
    """Return a function that makes a result from a document.

    The function raises ClientError if the document does not fit.
    """

    def read(document: Document) -> ResultT:
        from pydantic import ValidationError

        try:
            made: ResultT = _adapter(result).validate_python({**document, "document": document})
        except ValidationError as error:
            raise unexpected(document, str(error)) from error
        return made

    return read


def _adapter(result: type[Result]) -> "TypeAdapter[Any]":
    """Return the adapter of a result, made at first use: pydantic takes long to import."""
    if result not in _ADAPTERS:
        from pydantic import TypeAdapter

        _ADAPTERS[result] = TypeAdapter(result)
    return _ADAPTERS[result]


_ADAPTERS: "Final[dict[type[Result], TypeAdapter[Any]]]" = {}
