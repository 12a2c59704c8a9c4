"""Telemetry: one message for each interval of time."""

from dataclasses import dataclass

from piezod.messages.documents import Message


@dataclass(frozen=True, kw_only=True)
class Range:
    """A quantity in one interval; no spike is lost at any rate of events.

    Attributes:
        min: Minimum of all cycles.
        max: Maximum of all cycles.
        last: Value in the last cycle.
    """

    min: float | None
    max: float | None
    last: float | None


@dataclass(frozen=True, kw_only=True)
class AxisTelemetry:
    """One axis in one interval.

    Attributes:
        mode: Mode of the compensator, in the last cycle.
        on_target: Whether in the last cycle the position had been within its tolerance for the
            settling time.
        motion: Number of the movement in the last cycle.
        target_um: Target of the movement, in µm.
        remaining_s: Time until the command is at the target, in s, in the last cycle; None if the
            movement does not end at a position.
        position_um: Measured position, in µm.
        command_um: Commanded position, in µm.
        drive_v: Drive voltage, in V; in state BLIND the one that the amplifier reports.
        error_um: Command minus position, in µm.
    """

    mode: str = ""
    on_target: bool = False
    motion: int = 0
    target_um: float | None = None
    remaining_s: float | None = None
    position_um: Range
    command_um: Range
    drive_v: Range
    error_um: Range


@dataclass(frozen=True, kw_only=True)
class Telemetry(Message):
    """All axes in one interval.

    Attributes:
        t_s: Time of the last cycle on the monotonic clock of the daemon, in s.
        cycles: Number of cycles in the interval.
        lost: Number of further cycles, lost because this client was too slow.
        state: State in the last cycle.
        shadow: Whether the stage is in shadow mode: everything is computed, nothing written.
        faults: Ids of the faults that were present in any cycle or are latched.
        skipped_cycles: Number of skipped cycles since the loop started.
        late_max_us: Largest lateness of a cycle in the interval, in µs; None from an older daemon.
        axes: Axes by name.
    """

    t_s: float
    cycles: int
    lost: int
    state: str
    shadow: bool = False
    faults: tuple[str, ...]
    skipped_cycles: int
    late_max_us: float | None = None
    axes: dict[str, AxisTelemetry]
