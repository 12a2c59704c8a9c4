"""What an axis follows, and what its control law returns in a cycle."""

from collections.abc import Callable

from piezod.config.drive_limits import DriveLimit

TimeFunction = Callable[[float], float]
"""A quantity over time: seconds since its start to µm or V."""


class AxisOutput:
    """Output of an axis in one cycle.

    Args:
        drive_v: Voltage to write, within the limits, in V.
        command_um: Command at the instant of the cycle, in µm; NaN for an open-loop drive.
        uncompensated_v: Voltage in proportion to that command, in V.
        in_force_v: Voltage that was in force when the sample was taken, in V.
        t_ns: Instant of the cycle for which it was made, in ns.
        limited: What keeps the drive from following the command; a forced voltage has none.
    """

    __slots__ = ("command_um", "drive_v", "in_force_v", "limited", "t_ns", "uncompensated_v")

    def __init__(
        self,
        drive_v: float,
        command_um: float,
        uncompensated_v: float,
        in_force_v: float,
        t_ns: int,
        limited: DriveLimit = DriveLimit.NONE,
    ) -> None:
        self.drive_v, self.command_um, self.uncompensated_v = drive_v, command_um, uncompensated_v
        self.in_force_v, self.t_ns, self.limited = in_force_v, t_ns, limited
