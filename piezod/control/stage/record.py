"""What one cycle of a stage leaves: all that a client, a recording or a person may want to know."""

from collections.abc import Sequence
from typing import NamedTuple

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.law.gate import GateReason


class Answer(NamedTuple):
    """What becomes of a request.

    Attributes:
        accepted: Whether it is carried out.
        why: Why not, and what would help; empty where it is accepted.
        motion: Number of the movement that it started, 0 where it started none.
    """

    accepted: bool
    why: str = ""
    motion: int = 0


class AxisRecord(NamedTuple):
    """One axis in one cycle.

    Attributes:
        sample_ns: Instant at which the sample was taken.
        position_um: Measured displacement, NaN where the sample may not be used.
        command_um: Displacement asked for at the instant of the cycle, NaN where there is none.
        target_um: Where the movement ends, NaN where it does not end at a position.
        uncompensated_v: Voltage in proportion to the command.
        asked_v: Voltage that the axis asked for.
        drive_v: Voltage that the guard let through and that was written; in force from now on.
        in_force_v: Voltage that was in force when the sample was taken.
        read_back_v: Voltage that the amplifier tells, NaN where it does not.
        trim_um: What mode `trimmed` adds to the command now.
        mode: How the drive is made from the command.
        gate: Whether the identifier learns, and if not, why not.
        on_target: Whether the position has been reached, and stayed.
        motion: Number of the movement, one more with each that is accepted.
    """

    sample_ns: int
    position_um: float
    command_um: float
    target_um: float
    uncompensated_v: float
    asked_v: float
    drive_v: float
    in_force_v: float
    read_back_v: float
    trim_um: float
    mode: Mode
    gate: GateReason
    on_target: bool
    motion: int


class StageRecord(NamedTuple):
    """All axes in one cycle.

    Attributes:
        t_ns: Instant of the cycle.
        state: What the daemon does with the stage.
        shadow: Whether everything is computed and nothing written.
        written: Whether the amplifier took the voltages; True where none were to be written.
        present: Faults that are present, bit `1 << index` of `control.faults.table.FAULTS`.
        latched: Faults that are latched, likewise.
        axes: The axes, in their order.
    """

    t_ns: int
    state: State
    shadow: bool
    written: bool
    present: int
    latched: int
    axes: Sequence[AxisRecord]


class StageEvent(NamedTuple):
    """Something that happened, for log and audit.

    Attributes:
        t_ns: Instant of the cycle.
        severity: "info", "warning" or "error".
        kind: What happened, as in "state", "fault", "fault-cleared", "request".
        text: For people: what, which value, which limit, what to do.
        fault: Name of the fault; empty where it is none.
        axis: Name of the axis; empty where it concerns all.
        measured: The value that was found, NaN where there is none.
        limit: What it was compared with, NaN where there is none.
    """

    t_ns: int
    severity: str
    kind: str
    text: str
    fault: str = ""
    axis: str = ""
    measured: float = float("nan")
    limit: float = float("nan")
