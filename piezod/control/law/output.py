"""What an axis follows, and what its control law returns in a cycle."""

from collections.abc import Callable
from typing import NamedTuple

from piezod.config.drive_limits import DriveLimit

TimeFunction = Callable[[float], float]
"""A quantity over time: seconds since its start to µm or V."""


class AxisOutput(NamedTuple):
    """Output of an axis in one cycle."""

    drive_v: float  #: Voltage to write, within the limits, in V.
    command_um: float  #: Command at the instant of the cycle, in µm; NaN for an open-loop drive.
    uncompensated_v: float  #: Voltage in proportion to that command, in V.
    in_force_v: float  #: Voltage that was in force when the sample was taken, in V.
    t_ns: int  #: Instant of the cycle for which it was made, in ns.
    #: What keeps the drive from following the command; a forced voltage has none.
    limited: DriveLimit = DriveLimit.NONE
