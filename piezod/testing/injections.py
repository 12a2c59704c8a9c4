"""Kinds of device failures, and the schedule entries of a `FaultyDevice`."""

from enum import StrEnum
from math import inf, nan
from typing import NamedTuple

from piezod.devices.status import DeviceFlag


class InjectionKind(StrEnum):
    """Kind of failure, and the meaning of the value of an injection."""

    STUCK = "stuck"
    """The displacement stays at its value from the start of the fault."""
    REPLACED = "replaced"
    """The displacement is the value, in µm; NaN and infinities are allowed."""
    OFFSET = "offset"
    """The value is added to the displacement, in µm."""
    GAIN = "gain"
    """The displacement is multiplied by the value; by a negative one to reverse it."""
    NOISE = "noise"
    """Normal noise is added to the displacement; the value is its standard deviation in µm."""
    GARBAGE = "garbage"
    """The displacement is drawn from minus to plus the value, in µm."""
    DROPPED = "dropped"
    """Samples are invalid."""
    LATE = "late"
    """Samples are those of `value` ns before, with their time stamps."""
    DUPLICATE = "duplicate"
    """The last sample before the fault is repeated, with its time stamp."""
    REFUSED = "refused"
    """Writes are refused as a whole."""
    UNACKNOWLEDGED = "unacknowledged"
    """Writes are taken, and told as refused."""
    STUCK_OUTPUT = "stuck output"
    """Writes are acknowledged, but the voltage stays."""
    READ_BACK_OFFSET = "read-back offset"
    """The value is added to the read-back voltage, in V."""
    FLAGGED = "flagged"
    """The status of input and output has the flag."""
    SENSOR_FLAGGED = "sensor flagged"
    """The status of the input alone has the flag."""
    LOST = "lost"
    """Samples are invalid, writes are refused, read-back is NaN, and the status has the flag."""
    READ_RAISES = "read raises"
    """The driver raises while it reads a sample."""
    WRITE_RAISES = "write raises"
    """The driver raises while it writes."""


class Injection(NamedTuple):
    """One fault."""

    kind: InjectionKind  #: Kind of failure.
    start_ns: int  #: First instant of the fault.
    end_ns: float = inf  #: End of the fault, exclusive.
    axis: int = 0  #: Index of the axis.
    value: float = nan  #: Size of the fault, see `InjectionKind`.
    flag: DeviceFlag = DeviceFlag.OVERLOAD  #: Flag in the status, for kinds that set one.
