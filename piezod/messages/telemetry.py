"""Telemetry: one message for each interval of time."""

from dataclasses import dataclass
from typing import Annotated

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.messages.documents import Message
from piezod.messages.shown import COLUMN, DETAIL, NEEDED, UNARCHIVED, Shown


@dataclass(frozen=True, kw_only=True)
class Range:
    """A quantity in one interval; no spike is lost at any rate of events."""

    min: float | None  #: Minimum of all cycles.
    max: float | None  #: Maximum of all cycles.
    last: float | None  #: Value in the last cycle.


@dataclass(frozen=True, kw_only=True)
class AxisTelemetry:
    """One axis in one interval."""

    #: Measured position, in µm.
    position_um: Annotated[Range, Shown("position", "POS", "Measured position", COLUMN | NEEDED)]
    #: Commanded position, in µm.
    command_um: Annotated[Range, Shown("command", "CMD", "Commanded position", COLUMN)]
    #: Command minus position, in µm.
    error_um: Annotated[Range, Shown("error", "ERR", "Command minus position", COLUMN)]
    #: Drive voltage, in V; in state BLIND the one that the amplifier reports.
    drive_v: Annotated[Range, Shown("drive", "DRIVE", "Drive voltage", COLUMN | NEEDED)]
    #: Target of the movement, in µm.
    target_um: Annotated[
        float | None, Shown("target", "TARGET", "Target of the movement", DETAIL | UNARCHIVED)
    ] = None
    #: Whether in the last cycle the position had been within its tolerance for the settling time.
    on_target: Annotated[bool, Shown("on target", "ONTARGET", "On target", DETAIL)] = False
    #: Mode of the compensator, in the last cycle.
    mode: Annotated[str, Shown("mode", "MODE_RBV", "Mode in use", choices=Mode)] = ""
    motion: int = 0  #: Number of the movement in the last cycle.
    #: Time until the command is at the target, in s, in the last cycle; None if the movement does
    #: not end at a position.
    remaining_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Telemetry(Message):
    """All axes in one interval."""

    t_s: float  #: Time of the last cycle on the monotonic clock of the daemon, in s.
    cycles: int  #: Number of cycles in the interval.
    lost: int  #: Number of further cycles, lost because this client was too slow.
    #: State in the last cycle.
    state: Annotated[str, Shown("state", "STATE", "State of the stage", choices=State)]
    #: Whether the stage is in shadow mode: everything is computed, nothing written.
    shadow: Annotated[
        bool, Shown("shadow", "SHADOW", "Shadow mode: nothing is written", UNARCHIVED)
    ] = False
    faults: tuple[str, ...]  #: Ids of the faults that were present in any cycle or are latched.
    #: Number of skipped cycles since the loop started.
    skipped_cycles: Annotated[
        int,
        Shown("skipped cycles", "LOOP:SKIPPED", "Skipped cycles since the start", DETAIL),
    ]
    #: Largest lateness of a cycle in the interval, in µs; None from an older daemon.
    late_max_us: Annotated[
        float | None, Shown("lateness", "LOOP:LATE", "Largest lateness of a cycle", NEEDED)
    ] = None
    axes: dict[str, AxisTelemetry]  #: Axes by name.
