"""What a stage tells: an answer for each endpoint, typed once for the daemon and its clients.

The daemon builds these objects and writes them as JSON; clients read the same classes from it. The
comments beside the fields are the words of the OpenAPI description. A field with a default may be
missing in the answer of an older daemon. This module imports little, because every client does.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Annotated, Final

from piezod.config.drive_limits import DriveLimit
from piezod.messages.documents import Document, Message
from piezod.messages.shown import COLUMN, DETAIL, UNARCHIVED, Shown, shown_fields
from piezod.messages.telemetry import AxisTelemetry, Telemetry


@dataclass(frozen=True, kw_only=True)
class Answer(Message):
    """A request that the loop has accepted."""

    accepted: bool = True  #: Always true.
    motion: int = 0  #: Number of the movement that it started, 0 if it started none.
    #: Time until it can be on target, in s: until its command is at the target, and the settling
    #: time; 0 without a movement, and from an older daemon.
    duration_s: float = 0.0
    state: str = ""  #: State of the stage then, one of `piezod.config.states.State`.


@dataclass(frozen=True, kw_only=True)
class StreamEnd(Message):
    """A stream of setpoints that has ended."""

    accepted: bool = True  #: Always true.
    setpoints: int  #: Number of setpoints.


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault that is present or latched."""

    id: str  #: Id in docs/faults.md, for example "S5".
    name: str = ""  #: Short description.
    severity: str = "error"  #: "info", "warning" or "error"; an older daemon does not report it.
    present: bool = True  #: Whether the fault is present now.
    latched: bool = False  #: Whether the fault stays until it is reset.
    remedy: str = ""  #: What the user can do.


@dataclass(frozen=True, kw_only=True)
class AxisStatus:
    """One axis in the newest cycle.

    The fields with the name of a field of `AxisRecord` are that of the newest record.
    """

    has_sensor: bool = True  #: Whether a sensor measures the axis.
    unit: str = "µm"  #: Unit of its positions, also where a name ends in `_um`: µm or µrad.
    #: User axes that move it, "x, y": it takes no commands of its own; empty if it does.
    moved_by: str = ""
    position_um: float | None = None  #: Measured position, in µm; None without a usable sample.
    command_um: float | None = None  #: Commanded position, in µm; None if there is none.
    #: Drive voltage, in V; in state BLIND the one that the amplifier reports.
    drive_v: float | None = None
    #: Position at which the movement ends, in µm; None if it ends at none.
    target_um: float | None = None
    #: Voltage that the amplifier reports, in V; None if it does not.
    read_back_v: Annotated[float | None, Shown("read-back voltage", marks=DETAIL)] = None
    #: Displacement that mode `trimmed` or `closed` adds now, in µm.
    trim_um: Annotated[float | None, Shown("trim", marks=DETAIL)] = None
    mode: str = ""  #: Mode of the compensator, one of `piezod.config.modes.Mode`.
    #: Whether the identifier learns, and if not, why not.
    gate: Annotated[str, Shown("learning", marks=DETAIL)] = ""
    #: Whether the position has been within its tolerance for the settling time.
    on_target: bool = False
    motion: int = 0  #: Number of the movement; each accepted movement gets the next number.
    limited: str = DriveLimit.NONE.value  #: What limits the drive: `none`, `range` or `slew rate`.
    #: Time until the command is at the target, in s; 0 from then on, None if the movement does not
    #: end at a position.
    remaining_s: float | None = None
    #: How far the learned model is from the identified one, in % of the range; None if nothing has
    #: been learned.
    learned_pct: float | None = None

    @property
    def error_um(self) -> float | None:
        """Command minus position, in µm; None if one of them is unknown."""
        if self.command_um is None or self.position_um is None:
            return None
        return self.command_um - self.position_um

    def row(self, name: str) -> tuple[str, ...]:
        """Return the row of an axis in the table of a notebook."""
        shown = (each.text(getattr(self, each.name)) for each in COLUMNS)
        return (name, *shown, "yes" if self.on_target else "no")


AXIS: Final = shown_fields(AxisTelemetry, AxisStatus)
"""The fields of an axis that are shown, by name."""
COLUMNS: Final = tuple(each for each in AXIS.values() if each.has(COLUMN))
"""Those that tables of axes have."""


@dataclass(frozen=True, kw_only=True)
class Processor:
    """The processor of a loop."""

    number: int  #: Its number.
    shared_with: int = 0  #: Number of loops of other stages that had it when this one started.


@dataclass(frozen=True, kw_only=True)
class Holder:
    """The client that has the lease."""

    user: str = ""  #: Name of its user.
    uid: int = -1  #: Number of that user.
    client: str = ""  #: Name of the client; empty if it has none.

    def __str__(self) -> str:
        """Return the user, with the name of the client."""
        return f"{self.user} ({self.client})" if self.client else self.user


@dataclass(frozen=True, kw_only=True)
class Lease(Message):
    """The lease of a stage."""

    holder: Holder = Holder()  #: Who has it.
    #: Time until it expires, in s; None during a session, at whose end it expires.
    expires_in_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Released(Message):
    """The lease after a release."""

    released: bool = False  #: Whether the client had it, without a session.


@dataclass(frozen=True, kw_only=True)
class Status(Message):
    """A stage in its newest cycle."""

    stage: str = ""  #: Name of the stage.
    title: str = ""  #: Title of the stage, for people.
    state: str  #: One of `piezod.config.states.State`.
    #: Mode of all axes; "mixed" if they differ.
    mode: Annotated[str, Shown("mode", marks=COLUMN)]
    #: Whether the stage is in shadow mode: everything is computed, nothing written.
    shadow: bool = False
    faults: tuple[Fault, ...]  #: Faults that are present or latched.
    #: Configured cycles per second; None if the daemon does not report it.
    rate_hz: Annotated[
        float | None,
        Shown("loop rate", "LOOP:RATE", "Cycles per second, as configured", DETAIL | UNARCHIVED),
    ] = None
    skipped_cycles: int  #: Number of skipped cycles since the loop started.
    #: Processor of the loop; None if the loop has none of its own choice.
    processor: Processor | None = None
    #: "compiled" if the modules that a cycle runs are machine code, else "interpreted"; empty if
    #: the daemon does not tell.
    build: str = ""
    #: Names of the real-time settings that were not obtained.
    not_realtime: Annotated[tuple[str, ...], Shown("not real-time", marks=DETAIL)] = ()
    #: Devices as the loop found them: name, identity, placement, round trip, abilities.
    devices: tuple[Document, ...] = ()
    axes: dict[str, AxisStatus]  #: Axes by name, user axes first.
    #: How far the position is from the path of the command, whatever the time, in µm, or in µrad if
    #: only such user axes make a plane; None without user axes, or if it is unknown.
    contour_um: Annotated[float | None, Shown("contour error", marks=DETAIL)] = None
    lease: Lease | None = None  #: The lease; None if it is free.
    #: Role of this client: viewer, operator or engineer; empty if the daemon does not tell.
    role: str = ""

    def _repr_html_(self) -> str:
        """Return what a notebook shows: a line on the stage, and a table of its axes."""
        faults = ", ".join(f"{each.id} {each.name}".strip() for each in self.faults) or "none"
        shadow = ", shadow mode" if self.shadow else ""
        line = f"{self.stage or 'stage'}: {self.state}, mode {self.mode}{shadow}; faults: {faults}"
        headings = ("axis", *(each.heading for each in COLUMNS), "on target")
        return _html_table(line, headings, (axis.row(name) for name, axis in self.axes.items()))


STAGE: Final = shown_fields(Telemetry, Status)
"""The fields of a stage that are shown, by name."""


def _html_table(line: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a line of text and a table below it, as HTML."""
    head = "".join(f"<th>{escape(each)}</th>" for each in headings)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<p>{escape(line)}</p>{table}"


@dataclass(frozen=True, kw_only=True)
class Health(Message):
    """The health of the loop."""

    healthy: bool  #: Whether the loop runs cycles.
    cycle_age_s: float = 0.0  #: Time since its last cycle was seen, in s.


@dataclass(frozen=True, kw_only=True)
class Realtime(Message):
    """What the loop process obtained from the operating system, and its counters."""

    rate_hz: float = 0.0  #: Configured cycles per second.
    measured_rate_hz: float = 0.0  #: Cycles per second that loop and devices could run.
    loop_pid: int = 0  #: Number of the loop process.
    #: Real-time settings: name, what was wanted and obtained, and whether that is enough.
    steps: tuple[Document, ...] = ()
    devices: tuple[Document, ...] = ()  #: As in the status.
    processor: Processor | None = None  #: As in the status.
    healthy_cycles: int = 0  #: Number of cycles in time.
    skipped_cycles: int = 0  #: Number of skipped cycles.
    requests_expired: int = 0  #: Number of requests that were not taken in time.
    gc_collections: int = 0  #: Number of collections of garbage.
    minor_faults: int = 0  #: Number of page faults without the disk.
    major_faults: int = 0  #: Number of page faults with the disk.
    allocated_blocks: int = 0  #: Number of blocks of memory in use.


@dataclass(frozen=True, kw_only=True)
class Faults(Message):
    """Faults that are present or latched."""

    faults: tuple[Fault, ...]  #: The faults.


@dataclass(frozen=True, kw_only=True)
class ErrorText:
    """Why a request failed; some errors have further keys."""

    code: str  #: Word for programs.
    what: str  #: What happened, the value found, and the allowed values.
    remedy: str  #: What the user can do.


@dataclass(frozen=True, kw_only=True)
class ErrorDocument:
    """The answer to a request that failed."""

    error: ErrorText  #: Why.
