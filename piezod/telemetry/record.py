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
    """Record of one axis in one cycle."""

    sample_ns: int  #: Instant of the sample, in ns.
    position_um: float  #: Measured position, in µm; NaN if the sample may not be used.
    command_um: float  #: Command at the instant of the cycle, in µm; NaN if there is none.
    #: Position at which the movement ends, in µm; NaN if it does not end at a position.
    target_um: float
    uncompensated_v: float  #: Voltage in proportion to the command, in V.
    asked_v: float  #: Voltage that the axis requested, in V.
    #: Voltage that the guard admitted and that was written, in V; in force from now on.
    drive_v: float
    in_force_v: float  #: Voltage in force when the sample was taken, in V.
    read_back_v: float  #: Voltage that the amplifier reports, in V; NaN if it does not.
    trim_um: float  #: Displacement that mode `trimmed` or `closed` adds now, in µm.
    mode: Mode  #: Mode in which the drive is made from the command.
    gate: GateReason  #: Whether the identifier learns, and if not, why not.
    on_target: bool  #: Whether the position has been reached and has stayed there.
    motion: int  #: Number of the movement; each accepted movement gets the next number.
    limited: DriveLimit  #: What limits the requested drive.
    #: Time until the command is at the target, in s; 0 from then on, NaN if the movement does not
    #: end at a position.
    remaining_s: float = float("nan")


class CycleRecord(NamedTuple):
    """Record of all axes in one cycle, as the control law returns it."""

    t_ns: int  #: Instant of the cycle, in ns.
    state: State  #: State of the stage.
    shadow: bool  #: Whether everything is computed and nothing written.
    written: bool  #: Whether the amplifiers took the voltages; True if there was nothing to write.
    present: int  #: Bit mask of the present faults; the bit is the index in `config.faults.Fault`.
    latched: int  #: Bit mask of the latched faults.
    axes: Sequence[AxisRecord]  #: Records of the axes, in order.
    #: Bit mask of the lines that are high; the bit is the index in the configuration.
    lines: int = 0


class CycleHeader(NamedTuple):
    """Part of a record in the ring before the axes."""

    t_ns: int  #: Instant of the cycle, in ns.
    late_ns: int  #: Wake-up after the deadline, in ns.
    read_ns: int  #: Duration of reading, with the read-back, in ns.
    compute_ns: int  #: Duration of everything between reading and writing, in ns.
    write_late_ns: int  #: Begin of the write after the deadline, in ns; -1 if nothing was written.
    write_ns: int  #: Duration of writing, in ns.
    skipped: int  #: Periods skipped since the start.
    present_lo: int  #: Bit mask of the present faults, the first 64 of them.
    present_hi: int  #: Bit mask of the present faults, the others.
    latched_lo: int  #: Bit mask of the latched faults, the first 64 of them.
    latched_hi: int  #: Bit mask of the latched faults, the others.
    #: Bit mask of the lines that are high: inputs as read, outputs as set in this cycle.
    lines: int
    state: State  #: State of the stage.
    shadow: bool  #: Whether everything is computed and nothing written.
    written: bool  #: Whether the amplifiers took the voltages; True if there was nothing to write.


class StageEvent(NamedTuple):
    """An event, for log and audit."""

    t_ns: int  #: Instant of the cycle, in ns.
    severity: str  #: "info", "warning" or "error".
    kind: str  #: Kind of event, as "state", "fault", "fault-cleared", "request".
    text: str  #: Text for people: event, value, limit, remedy.
    fault: str = ""  #: Id of the fault; empty if there is none.
    axis: str = ""  #: Name of the axis; empty if the event concerns all.
    measured: float = float("nan")  #: Measured value, NaN if there is none.
    limit: float = float("nan")  #: Limit of that value, NaN if there is none.
