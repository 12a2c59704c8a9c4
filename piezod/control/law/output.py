"""What an axis follows, and what its control law returns in a cycle."""

from collections.abc import Callable
from typing import NamedTuple

from piezod.config.drive_limits import DriveLimit

TimeFunction = Callable[[float], float]
"""A quantity over time: seconds since its start to µm or V."""


class AxisOutput(NamedTuple):
    """Output of an axis in one cycle.

    Attributes:
        drive_v: Voltage to write, within the limits, in V.
        command_um: Command at the instant of the cycle, in µm; NaN for an open-loop drive.
        uncompensated_v: Voltage in proportion to that command, in V.
        in_force_v: Voltage that was in force when the sample was taken, in V.
        t_ns: Instant of the cycle for which it was made, in ns.
        limited: What keeps the drive from following the command; a forced voltage has none.
    """

    drive_v: float
    command_um: float
    uncompensated_v: float
    in_force_v: float
    t_ns: int
    limited: DriveLimit = DriveLimit.NONE
