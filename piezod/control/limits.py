"""What the drive of an axis may do: stay in its range and not move faster than its slew rate."""

from typing import NamedTuple

READ_BACK_V, READ_BACK_PART = 0.5, 0.005
"""What is read back may differ from what was written by this, or by this part of the range."""


def read_back_tolerance_v(drive_min_v: float, drive_max_v: float) -> float:
    """Return by how much what is read back may differ from what was written, in V.

    It is what noise and offset of an amplifier's own measurement may be; whoever asks whether a
    stage is at a voltage, asks within this.

    Args:
        drive_min_v: Lowest voltage of the axis, in V.
        drive_max_v: Highest, in V.
    """
    return max(READ_BACK_V, READ_BACK_PART * (drive_max_v - drive_min_v))


class Window(NamedTuple):
    """The drive that the limits leave open in one cycle, in V."""

    low_v: float
    high_v: float

    def admit(self, drive_v: float, previous_v: float) -> float:
        """Return the nearest voltage inside; one that is not finite moves nothing.

        May be called in the loop.
        """
        if drive_v - drive_v != 0.0:  # infinite or not a number; clamps would make full scale of it
            return previous_v
        return min(max(drive_v, self.low_v), self.high_v)


class Limits(NamedTuple):
    """Limits of one axis.

    Attributes:
        drive_min_v: Lowest voltage, in V.
        drive_max_v: Highest voltage, in V.
        slew_v_per_s: Fastest change, in V/s.
    """

    drive_min_v: float
    drive_max_v: float
    slew_v_per_s: float

    @property
    def read_back_tolerance_v(self) -> float:
        """By how much what is read back may differ from what was written, in V."""
        return read_back_tolerance_v(self.drive_min_v, self.drive_max_v)

    def window(self, previous_v: float, elapsed_s: float) -> Window:
        """Return what may follow a voltage after a time; may be called in the loop.

        A previous voltage outside the range (a stage taken over) is brought back at the slew rate.
        """
        reach_v = self.slew_v_per_s * elapsed_s
        low_v = min(max(previous_v - reach_v, self.drive_min_v), previous_v + reach_v)
        high_v = max(min(previous_v + reach_v, self.drive_max_v), previous_v - reach_v)
        return Window(low_v, high_v)

    def admit(self, drive_v: float, previous_v: float, elapsed_s: float) -> float:
        """Return what `Window.admit` does, for the window after a time; call it in the loop."""
        return self.window(previous_v, elapsed_s).admit(drive_v, previous_v)
