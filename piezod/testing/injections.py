"""What can be wrong with a device, and when: the schedule of a `FaultyDevice`."""

from enum import StrEnum
from math import inf, nan
from typing import NamedTuple

from piezod.devices.status import DeviceFlag


class InjectionKind(StrEnum):
    """How a device fails, and what the value of an injection means for it."""

    STUCK = "stuck"
    """The displacement stays at what it was when the fault began."""
    REPLACED = "replaced"
    """The displacement is the value, in µm; NaN and infinite ones too."""
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
    """Samples are those of so many ns before, time stamps and all."""
    DUPLICATE = "duplicate"
    """The last sample before the fault is told again and again, time stamp and all."""
    REFUSED = "refused"
    """Writes are refused as a whole."""
    STUCK_OUTPUT = "stuck output"
    """Writes are acknowledged, and the voltage stays."""
    READ_BACK_OFFSET = "read-back offset"
    """The value is added to the voltage that is read back, in V."""
    FLAGGED = "flagged"
    """The status of input and output says so."""
    SENSOR_FLAGGED = "sensor flagged"
    """The status of the input alone says so."""
    LOST = "lost"
    """Samples are invalid, writes are refused, the voltage is not known, and the status says so."""
    READ_RAISES = "read raises"
    """The driver raises while it reads a sample."""
    WRITE_RAISES = "write raises"
    """The driver raises while it writes."""


class Injection(NamedTuple):
    """One fault.

    Attributes:
        kind: What fails.
        start_ns: From this instant on,
        end_ns: and before this one.
        axis: Index of the axis.
        value: How much, see `InjectionKind`.
        flag: What the status says, where it says something.
    """

    kind: InjectionKind
    start_ns: int
    end_ns: float = inf
    axis: int = 0
    value: float = nan
    flag: DeviceFlag = DeviceFlag.OVERLOAD
