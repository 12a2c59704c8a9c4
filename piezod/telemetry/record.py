"""The record of a cycle: declarations from which the layout of the ring and its readers derive.

`layout` derives the memory layout from the annotations, `encoder` the values, and recordings take
their columns from the layout. A new field needs one line here, and the place that fills it.
"""

from collections.abc import Sequence
from typing import NamedTuple

from piezod.config.drive_limits import DriveLimit
from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.states import State


class AxisRecord(NamedTuple):
    """Record of one axis in one cycle.

    Attributes:
        sample_ns: Instant of the sample, in ns.
        position_um: Measured position, in µm; NaN if the sample may not be used.
        command_um: Command at the instant of the cycle, in µm; NaN if there is none.
        target_um: Position at which the movement ends, in µm; NaN if it does not end at a position.
        uncompensated_v: Voltage in proportion to the command, in V.
        asked_v: Voltage that the axis requested, in V.
        drive_v: Voltage that the guard admitted and that was written, in V; in force from now on.
        in_force_v: Voltage in force when the sample was taken, in V.
        read_back_v: Voltage that the amplifier reports, in V; NaN if it does not.
        trim_um: Displacement that mode `trimmed` adds now, in µm.
        mode: Mode in which the drive is made from the command.
        gate: Whether the identifier learns, and if not, why not.
        on_target: Whether the position has been reached and has stayed there.
        motion: Number of the movement; each accepted movement gets the next number.
        limited: What limits the requested drive.
        remaining_s: Time until the command is at the target, in s; 0 from then on, NaN if the
            movement does not end at a position.
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
    limited: DriveLimit
    remaining_s: float = float("nan")


class CycleRecord(NamedTuple):
    """Record of all axes in one cycle, as the control law returns it.

    Attributes:
        t_ns: Instant of the cycle, in ns.
        state: State of the stage.
        shadow: Whether everything is computed and nothing written.
        written: Whether the amplifiers took the voltages; True if there was nothing to write.
        present: Bit mask of the present faults; the bit is the index in `config.faults.Fault`.
        latched: Bit mask of the latched faults.
        axes: Records of the axes, in order.
    """

    t_ns: int
    state: State
    shadow: bool
    written: bool
    present: int
    latched: int
    axes: Sequence[AxisRecord]


class CycleHeader(NamedTuple):
    """Part of a record in the ring before the axes.

    Attributes:
        t_ns: Instant of the cycle, in ns.
        late_ns: Wake-up after the deadline, in ns.
        read_ns: Duration of reading, with the read-back, in ns.
        compute_ns: Duration of everything between reading and writing, in ns.
        write_late_ns: Begin of the write after the deadline, in ns; -1 if nothing was written.
        write_ns: Duration of writing, in ns.
        skipped: Periods skipped since the start.
        present_lo: Bit mask of the present faults, the first 64 of them.
        present_hi: Bit mask of the present faults, the others.
        latched_lo: Bit mask of the latched faults, the first 64 of them.
        latched_hi: Bit mask of the latched faults, the others.
        state: State of the stage.
        shadow: Whether everything is computed and nothing written.
        written: Whether the amplifiers took the voltages; True if there was nothing to write.
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
    """An event, for log and audit.

    Attributes:
        t_ns: Instant of the cycle, in ns.
        severity: "info", "warning" or "error".
        kind: Kind of event, as "state", "fault", "fault-cleared", "request".
        text: Text for people: event, value, limit, remedy.
        fault: Id of the fault; empty if there is none.
        axis: Name of the axis; empty if the event concerns all.
        measured: Measured value, NaN if there is none.
        limit: Limit of that value, NaN if there is none.
    """

    t_ns: int
    severity: str
    kind: str
    text: str
    fault: str = ""
    axis: str = ""
    measured: float = float("nan")
    limit: float = float("nan")
