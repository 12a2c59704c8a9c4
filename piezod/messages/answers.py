"""What a stage tells: an answer for each endpoint, typed once for the daemon and its clients.

The daemon builds these objects and writes them as JSON; clients read the same classes from it. The
`Attributes:` of a class are the words of the OpenAPI description. A field with a default may be
missing in the answer of an older daemon. This module imports little, because every client does.
"""

from dataclasses import dataclass
from typing import Final

from piezod.config.drive_limits import DriveLimit
from piezod.messages.documents import Document, Message
from piezod.messages.notebook import html_table

_HEADINGS: Final = (
    "axis", "position/µm", "command/µm", "error/µm", "drive/V", "on target",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Answer(Message):
    """A request that the loop has accepted.

    Attributes:
        accepted: Always true.
        motion: Number of the movement that it started, 0 if it started none.
        duration_s: Time until it can be on target, in s: until its command is at the target, and
            the settling time; 0 without a movement, and from an older daemon.
        state: State of the stage then, one of `piezod.config.states.State`.
    """

    accepted: bool = True
    motion: int = 0
    duration_s: float = 0.0
    state: str = ""


@dataclass(frozen=True, kw_only=True)
class StreamEnd(Message):
    """A stream of setpoints that has ended.

    Attributes:
        accepted: Always true.
        setpoints: Number of setpoints.
    """

    accepted: bool = True
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

    The fields with the name of a field of `AxisRecord` are that of the newest record.

    Attributes:
        has_sensor: Whether a sensor measures the axis.
        position_um: Measured position, in µm; None without a usable sample.
        command_um: Commanded position, in µm; None if there is none.
        drive_v: Drive voltage, in V; in state BLIND the one that the amplifier reports.
        target_um: Position at which the movement ends, in µm; None if it ends at none.
        read_back_v: Voltage that the amplifier reports, in V; None if it does not.
        trim_um: Displacement that mode `trimmed` adds now, in µm.
        mode: Mode of the compensator, one of `piezod.config.modes.Mode`.
        gate: Whether the identifier learns, and if not, why not.
        on_target: Whether the position has been within its tolerance for the settling time.
        motion: Number of the movement; each accepted movement gets the next number.
        limited: What limits the drive: `none`, `range` or `slew rate`.
        remaining_s: Time until the command is at the target, in s; 0 from then on, None if the
            movement does not end at a position.
        learned_pct: How far the learned model is from the identified one, in % of the range; None
            if nothing has been learned.
    """

    has_sensor: bool = True
    position_um: float | None = None
    command_um: float | None = None
    drive_v: float | None = None
    target_um: float | None = None
    read_back_v: float | None = None
    trim_um: float | None = None
    mode: str = ""
    gate: str = ""
    on_target: bool = False
    motion: int = 0
    limited: str = DriveLimit.NONE.value
    remaining_s: float | None = None
    learned_pct: float | None = None

    @property
    def error_um(self) -> float | None:
        """Command minus position, in µm; None if one of them is unknown."""
        if self.command_um is None or self.position_um is None:
            return None
        return self.command_um - self.position_um

    def row(self, name: str) -> tuple[str, ...]:
        """Return the row of an axis in the table of a notebook."""
        values = (self.position_um, self.command_um, self.error_um, self.drive_v)
        numbers = ("–" if value is None else f"{value:.3f}" for value in values)
        return (name, *numbers, "yes" if self.on_target else "no")


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
class Holder:
    """The client that has the lease.

    Attributes:
        user: Name of its user.
        uid: Number of that user.
        client: Name of the client; empty if it has none.
    """

    user: str = ""
    uid: int = -1
    client: str = ""

    def __str__(self) -> str:
        """Return the user, with the name of the client."""
        return f"{self.user} ({self.client})" if self.client else self.user


@dataclass(frozen=True, kw_only=True)
class Lease(Message):
    """The lease of a stage.

    Attributes:
        holder: Who has it.
        expires_in_s: Time until it expires, in s; None during a session, at whose end it expires.
    """

    holder: Holder = Holder()
    expires_in_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Released(Message):
    """The lease after a release.

    Attributes:
        released: Whether the client had it, without a session.
    """

    released: bool = False


@dataclass(frozen=True, kw_only=True)
class Status(Message):
    """A stage in its newest cycle.

    Attributes:
        stage: Name of the stage.
        title: Title of the stage, for people.
        state: One of `piezod.config.states.State`.
        mode: Mode of all axes; "mixed" if they differ.
        shadow: Whether the stage is in shadow mode: everything is computed, nothing written.
        faults: Faults that are present or latched.
        rate_hz: Configured cycles per second; None if the daemon does not report it.
        skipped_cycles: Number of skipped cycles since the loop started.
        processor: Processor of the loop; None if the loop has none of its own choice.
        not_realtime: Names of the real-time settings that were not obtained.
        devices: Devices as the loop found them: name, identity, placement, round trip, abilities.
        axes: Axes by name.
        lease: The lease; None if it is free.
        role: Role of this client: viewer, operator or engineer; empty if the daemon does not tell.
    """

    stage: str = ""
    title: str = ""
    state: str
    mode: str
    shadow: bool = False
    faults: tuple[Fault, ...]
    rate_hz: float | None = None
    skipped_cycles: int
    processor: Processor | None = None
    not_realtime: tuple[str, ...] = ()
    devices: tuple[Document, ...] = ()
    axes: dict[str, AxisStatus]
    lease: Lease | None = None
    role: str = ""

    def _repr_html_(self) -> str:
        """Return what a notebook shows: a line on the stage, and a table of its axes."""
        faults = ", ".join(f"{each.id} {each.name}".strip() for each in self.faults) or "none"
        shadow = ", shadow mode" if self.shadow else ""
        line = f"{self.stage or 'stage'}: {self.state}, mode {self.mode}{shadow}; faults: {faults}"
        return html_table(line, _HEADINGS, (axis.row(name) for name, axis in self.axes.items()))


@dataclass(frozen=True, kw_only=True)
class Health(Message):
    """The health of the loop.

    Attributes:
        healthy: Whether the loop runs cycles.
        cycle_age_s: Time since its last cycle was seen, in s.
    """

    healthy: bool
    cycle_age_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Realtime(Message):
    """What the loop process obtained from the operating system, and its counters.

    Attributes:
        rate_hz: Configured cycles per second.
        measured_rate_hz: Cycles per second that loop and devices could run.
        loop_pid: Number of the loop process.
        steps: Real-time settings: name, what was wanted and obtained, and whether that is enough.
        devices: As in the status.
        processor: As in the status.
        healthy_cycles: Number of cycles in time.
        skipped_cycles: Number of skipped cycles.
        requests_expired: Number of requests that were not taken in time.
        gc_collections: Number of collections of garbage.
        minor_faults: Number of page faults without the disk.
        major_faults: Number of page faults with the disk.
        allocated_blocks: Number of blocks of memory in use.
    """

    rate_hz: float = 0.0
    measured_rate_hz: float = 0.0
    loop_pid: int = 0
    steps: tuple[Document, ...] = ()
    devices: tuple[Document, ...] = ()
    processor: Processor | None = None
    healthy_cycles: int = 0
    skipped_cycles: int = 0
    requests_expired: int = 0
    gc_collections: int = 0
    minor_faults: int = 0
    major_faults: int = 0
    allocated_blocks: int = 0


@dataclass(frozen=True, kw_only=True)
class Faults(Message):
    """Faults that are present or latched.

    Attributes:
        faults: The faults.
    """

    faults: tuple[Fault, ...]


@dataclass(frozen=True, kw_only=True)
class ErrorText:
    """Why a request failed; some errors have further keys.

    Attributes:
        code: Word for programs.
        what: What happened, the value found, and the allowed values.
        remedy: What the user can do.
    """

    code: str
    what: str
    remedy: str


@dataclass(frozen=True, kw_only=True)
class ErrorDocument:
    """The answer to a request that failed.

    Attributes:
        error: Why.
    """

    error: ErrorText
