"""What one cycle leaves: the declarations that the layout of the ring and its readers derive from.

`layout` makes the memory layout from the annotations, `encoder` the values, and recordings take
their columns from the layout. A new field needs one line here, and the place that fills it.
"""

from collections.abc import Sequence
from typing import NamedTuple

from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.states import State


class AxisRecord(NamedTuple):
    """One axis in one cycle.

    Attributes:
        sample_ns: Instant at which the sample was taken.
        position_um: Measured position, NaN if the sample may not be used.
        command_um: Command at the instant of the cycle, NaN if there is none.
        target_um: Position at which the movement ends, NaN if it does not end at a position.
        uncompensated_v: Voltage in proportion to the command.
        asked_v: Voltage that the axis asked for.
        drive_v: Voltage that the guard let through and that was written; in force from now on.
        in_force_v: Voltage in force when the sample was taken.
        read_back_v: Voltage that the amplifier reports, NaN if it does not.
        trim_um: What mode `trimmed` adds to the command now.
        mode: How the drive is made from the command.
        gate: Whether the identifier learns, and if not, why not.
        on_target: Whether the position has been reached and has stayed there.
        motion: Number of the movement; each accepted movement gets the next number.
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


class CycleRecord(NamedTuple):
    """All axes in one cycle, as the control law leaves them.

    Attributes:
        t_ns: Instant of the cycle.
        state: State of the stage.
        shadow: Whether everything is computed and nothing written.
        written: Whether the amplifiers took the voltages; True if none were to be written.
        present: Faults that are present, bit `1 << place` in `config.faults.Fault`.
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


class CycleHeader(NamedTuple):
    """What the ring holds of a cycle before its axes.

    Attributes:
        t_ns: Instant of the cycle.
        late_ns: Wake-up after the deadline.
        read_ns: Time that reading took, read-back included.
        compute_ns: Time that everything between reading and writing took.
        write_late_ns: Begin of the write after the deadline, -1 if nothing was written.
        write_ns: Time that writing took.
        skipped: Periods skipped since the start.
        present_lo: Faults that are present, the first 64.
        present_hi: The others.
        latched_lo: Faults that are latched, the first 64.
        latched_hi: The others.
        state: State of the stage.
        shadow: Whether everything is computed and nothing written.
        written: Whether the amplifiers took the voltages; True if none were to be written.
    """

    t_ns: int
    late_ns: int
    read_ns: int
    compute_ns: int
    write_late_ns: int
    write_ns: int
    skipped: int
    present_lo: int
    present_hi: int
    latched_lo: int
    latched_hi: int
    state: State
    shadow: bool
    written: bool


class StageEvent(NamedTuple):
    """Something that happened, for log and audit.

    Attributes:
        t_ns: Instant of the cycle.
        severity: "info", "warning" or "error".
        kind: What happened, as in "state", "fault", "fault-cleared", "request".
        text: For people: what happened, value, limit, what to do.
        fault: Name of the fault; empty if it is none.
        axis: Name of the axis; empty if it concerns all.
        measured: The value that was found, NaN if there is none.
        limit: What it was compared with, NaN if there is none.
    """

    t_ns: int
    severity: str
    kind: str
    text: str
    fault: str = ""
    axis: str = ""
    measured: float = float("nan")
    limit: float = float("nan")
