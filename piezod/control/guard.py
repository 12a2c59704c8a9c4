"""The last thing before the write: finite, in range, no faster than allowed, and of this cycle.

Nothing above is trusted. A voltage that is not a number leaves the one in force as it is: a clamp
alone would make full scale of it.
"""

from collections.abc import Container, Sequence
from math import isfinite
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


class Admitted(NamedTuple):
    """What may be written in this cycle; axes by their index.

    Attributes:
        drive_v: Voltage of each axis; not finite where what is in force is unknown.
        writable: Whether all of it is known: else nothing at all may be written.
        refused: Axes whose voltage, asked for or in force, is not a number: theirs stays.
        range_limited: Axes that asked for a voltage outside their range.
        slew_limited: Axes that asked for a faster change than theirs.
        stale: Whether it was planned for another cycle: every voltage stays.
    """

    drive_v: list[float]
    writable: bool
    refused: tuple[int, ...]
    range_limited: tuple[int, ...]
    slew_limited: tuple[int, ...]
    stale: bool


class Guard:
    """Lets through what is allowed, for all axes; it remembers nothing.

    Args:
        limits: What the drive of each axis may do.
        longest_s: Longest time that counts for the slew rate, in s: after a pause the loop must not
            make up for it in one step.
    """

    def __init__(self, limits: Sequence[Limits], longest_s: float) -> None:
        self._limits, self._longest_s = tuple(limits), longest_s

    def admit(
        self,
        planned_t_ns: int,
        t_ns: int,
        asked_v: Sequence[float],
        in_force_v: Sequence[float],
        elapsed_s: float,
        sent_v: Sequence[float] | None = None,
        slew_halved: Container[int] = (),
    ) -> Admitted:
        """Return what may be written; may be called in the loop.

        Args:
            planned_t_ns: Instant of the cycle for which the voltages were made.
            t_ns: Instant of this cycle.
            asked_v: Voltage of each axis, in V; any float.
            in_force_v: Voltage in force on each axis, in V; not finite where it is unknown.
            elapsed_s: Time since the voltages in force were written, in s; any float.
            sent_v: What was sent last and not acknowledged, None where nothing was: it may be in
                force or not, so that what follows must be near enough to both.
            slew_halved: Axes that may go only half as fast as usual.
        """
        if planned_t_ns != t_ns:
            kept_v = list(in_force_v)
            return Admitted(kept_v, all(map(isfinite, kept_v)), (), (), (), True)
        elapsed_s = min(max(elapsed_s, 0.0), self._longest_s) if isfinite(elapsed_s) else 0.0
        drive_v: list[float] = []
        writable = True
        refused: tuple[int, ...] = ()
        range_limited: tuple[int, ...] = ()
        slew_limited: tuple[int, ...] = ()
        for axis, limits in enumerate(self._limits):
            wished_v, previous_v = asked_v[axis], in_force_v[axis]
            if not (isfinite(wished_v) and isfinite(previous_v)):
                refused += (axis,)
                writable = writable and isfinite(previous_v)
                drive_v.append(previous_v)
                continue
            target_v = min(max(wished_v, limits.drive_min_v), limits.drive_max_v)
            reach_s = elapsed_s / 2.0 if axis in slew_halved else elapsed_s
            admitted_v = limits.window(previous_v, reach_s).admit(target_v, previous_v)
            if sent_v is not None and isfinite(sent_v[axis]):
                admitted_v = limits.window(sent_v[axis], reach_s).admit(admitted_v, previous_v)
            if target_v != wished_v:
                range_limited += (axis,)
            if admitted_v != target_v:
                slew_limited += (axis,)
            drive_v.append(admitted_v)
        return Admitted(drive_v, writable, refused, range_limited, slew_limited, False)
