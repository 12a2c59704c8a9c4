"""Telemetry: one message for each interval of time."""

from dataclasses import dataclass

from piezod.messages.documents import Message


@dataclass(frozen=True, kw_only=True)
class Range:
    """A quantity in one interval; no spike is lost at any rate of events."""

    min: float | None  #: Minimum of all cycles.
    max: float | None  #: Maximum of all cycles.
    last: float | None  #: Value in the last cycle.


@dataclass(frozen=True, kw_only=True)
class AxisTelemetry:
    """One axis in one interval."""

    mode: str = ""  #: Mode of the compensator, in the last cycle.
    #: Whether in the last cycle the position had been within its tolerance for the settling time.
    on_target: bool = False
    motion: int = 0  #: Number of the movement in the last cycle.
    target_um: float | None = None  #: Target of the movement, in µm.
    #: Time until the command is at the target, in s, in the last cycle; None if the movement does
    #: not end at a position.
    remaining_s: float | None = None
    position_um: Range  #: Measured position, in µm.
    command_um: Range  #: Commanded position, in µm.
    drive_v: Range  #: Drive voltage, in V; in state BLIND the one that the amplifier reports.
    error_um: Range  #: Command minus position, in µm.


@dataclass(frozen=True, kw_only=True)
class Telemetry(Message):
    """All axes in one interval."""

    t_s: float  #: Time of the last cycle on the monotonic clock of the daemon, in s.
    cycles: int  #: Number of cycles in the interval.
    lost: int  #: Number of further cycles, lost because this client was too slow.
    state: str  #: State in the last cycle.
    #: Whether the stage is in shadow mode: everything is computed, nothing written.
    shadow: bool = False
    faults: tuple[str, ...]  #: Ids of the faults that were present in any cycle or are latched.
    skipped_cycles: int  #: Number of skipped cycles since the loop started.
    #: Largest lateness of a cycle in the interval, in µs; None from an older daemon.
    late_max_us: float | None = None
    axes: dict[str, AxisTelemetry]  #: Axes by name.
