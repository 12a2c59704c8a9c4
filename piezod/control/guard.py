"""The last check before the write: finite, in range, within the slew rate, and of this cycle.

The guard trusts no caller. A voltage that is not finite leaves the voltage in force as it is,
because a clamp alone would turn it into full scale. An output that does not follow its writes is
waited for: no write is farther from a live read-back than the slew rate allows.
"""

from collections.abc import Collection, Container, Hashable, Sequence
from math import inf, isfinite
from typing import TypeAlias

READ_BACK_V, READ_BACK_PART = 0.5, 0.005
"""The read-back may differ from the written voltage by this many volts, or by this share of the
range, whichever is larger."""


def read_back_tolerance_v(drive_min_v: float, drive_max_v: float) -> float:
    """Return the allowed difference between read-back and written voltage, in V.

    It covers noise and offset of an amplifier's own measurement. All checks whether a stage is at a
    voltage use it.

    Args:
        drive_min_v: Lowest voltage of the axis, in V.
        drive_max_v: Highest voltage of the axis, in V.
    """
    return max(READ_BACK_V, READ_BACK_PART * (drive_max_v - drive_min_v))


Window: TypeAlias = tuple[float, float]
"""Lowest and highest drive that the limits allow in one cycle, in V."""


def nearest(window: Window, drive_v: float) -> float:
    """Return the nearest voltage inside a window to a finite one. Real-time safe."""
    low_v, high_v = window
    return min(max(drive_v, low_v), high_v)


def admit_within(window: Window, drive_v: float, previous_v: float) -> float:
    """Return the nearest voltage inside; if `drive_v` is not finite, the previous voltage.

    Real-time safe.
    """
    if drive_v - drive_v != 0.0:  # infinity or NaN: a clamp would give full scale
        return previous_v
    return nearest(window, drive_v)


class Limits:
    """Limits of one axis; they do not change.

    Args:
        drive_min_v: Lowest voltage, in V.
        drive_max_v: Highest voltage, in V.
        slew_v_per_s: Fastest change, in V/s.
    """

    __slots__ = ("drive_max_v", "drive_min_v", "read_back_tolerance_v", "slew_v_per_s")

    def __init__(self, drive_min_v: float, drive_max_v: float, slew_v_per_s: float) -> None:
        self.drive_min_v, self.drive_max_v = drive_min_v, drive_max_v
        self.slew_v_per_s = slew_v_per_s
        self.read_back_tolerance_v = read_back_tolerance_v(drive_min_v, drive_max_v)
        """Allowed difference between read-back and written voltage, in V."""

    def reach_v(self, elapsed_s: float) -> float:
        """Return how far an output may have gone after a time, with the tolerance, in V."""
        return self.slew_v_per_s * elapsed_s + self.read_back_tolerance_v

    def window(self, previous_v: float, elapsed_s: float) -> Window:
        """Return the drives that may follow a voltage after a time. Real-time safe.

        A previous voltage outside the range, of a stage that was taken over, returns at the slew
        rate.
        """
        reach_v = self.slew_v_per_s * elapsed_s
        # The outer min and max let a voltage outside the range move towards it, never farther away.
        low_v = min(max(previous_v - reach_v, self.drive_min_v), previous_v + reach_v)
        high_v = max(min(previous_v + reach_v, self.drive_max_v), previous_v - reach_v)
        return low_v, high_v

    def admit(self, drive_v: float, previous_v: float, elapsed_s: float) -> float:
        """Return `admit_within` of the window after a time. Real-time safe."""
        return admit_within(self.window(previous_v, elapsed_s), drive_v, previous_v)


class Admitted:
    """Voltages that may be written in this cycle; axes are given by their index.

    Args:
        drive_v: Voltage of each axis, in V; not finite if the voltage in force is unknown.
        held: Axes that may not be written: the voltage in force is unknown, or its output is out of
            the reach of the last write. All axes of an amplifier are written together, so they are
            held together.
        refused: Axes whose requested voltage, or voltage in force, is not finite: they hold.
        range_limited: Axes that requested a voltage outside their range.
        slew_limited: Axes that requested a faster change than their slew rate.
        stale: Whether the voltages were planned for another cycle: all axes hold.
        waits: Axes whose output does not follow: they keep the last write.
    """

    __slots__ = ("drive_v", "held", "range_limited", "refused", "slew_limited", "stale", "waits")

    def __init__(
        self,
        drive_v: list[float],
        held: tuple[int, ...],
        refused: tuple[int, ...],
        range_limited: tuple[int, ...],
        slew_limited: tuple[int, ...],
        stale: bool,
        waits: tuple[int, ...] = (),
    ) -> None:
        self.drive_v, self.held, self.refused, self.waits = drive_v, held, refused, waits
        self.range_limited, self.slew_limited, self.stale = range_limited, slew_limited, stale

    @property
    def writable(self) -> bool:
        """Whether every axis may be written."""
        return not self.held


class Guard:
    """Limits the voltages of all axes. Stateless, real-time safe.

    Args:
        limits: Limits of the drive of each axis.
        longest_s: Longest time that counts for the slew rate, in s: after a pause the drive must
            not catch up in one step.
        amplifiers: Amplifier of each axis; one for all axes if it is empty.
    """

    def __init__(
        self, limits: Sequence[Limits], longest_s: float, amplifiers: Sequence[Hashable] = ()
    ) -> None:
        self._limits, self._longest_s = tuple(limits), longest_s
        self._fresh_v = [each.reach_v(longest_s) for each in limits]
        owners = amplifiers or [None] * len(limits)
        self._beside = [[i for i, other in enumerate(owners) if other == one] for one in owners]

    def admit(
        self,
        planned_t_ns: int,
        t_ns: int,
        asked_v: Sequence[float],
        in_force_v: Sequence[float],
        elapsed_s: float,
        sent_v: Sequence[float] | None = None,
        slew_halved: Container[int] = (),
        read_back_v: Sequence[float] | None = None,
        age_s: Sequence[float] | None = None,
        left: Collection[int] = (),
    ) -> Admitted:
        """Return the voltages that may be written.

        Args:
            planned_t_ns: Instant of the cycle for which the voltages were made, in ns.
            t_ns: Instant of this cycle, in ns.
            asked_v: Requested voltage of each axis, in V; any float.
            in_force_v: Voltage in force on each axis, in V; not finite if it is unknown.
            elapsed_s: Time since the voltages in force were written, in s; any float.
            sent_v: Voltages that were sent last and not acknowledged, None if there are none. They
                may be in force or not, so the new voltage must be within the slew rate of both.
            slew_halved: Axes whose slew rate is halved.
            read_back_v: Last read-back of each axis, in V; not finite if there is none, or if it is
                known to be false. None if no axis has one.
            age_s: Age of each read-back, in s: how long ago the first voltage was made that it
                cannot show. None if no read-back is older than this cycle.
            left: Axes that may not be written.
        """
        if planned_t_ns != t_ns:
            # A plan for another instant belongs to another position of the reference.
            kept_v = list(in_force_v)
            unknown = [axis for axis, each_v in enumerate(kept_v) if not isfinite(each_v)]
            admitted = Admitted(kept_v, self._together(unknown), (), (), (), True)
        else:
            admitted = self._limited(asked_v, in_force_v, elapsed_s, sent_v, slew_halved)
        if left:
            admitted.held = self._together([*admitted.held, *left])
        if read_back_v is None:
            return admitted
        return self._awaiting(admitted, in_force_v, read_back_v, age_s)

    def _together(self, unknown: Sequence[int]) -> tuple[int, ...]:
        """Return all axes of the amplifiers of these axes, in order."""
        if not unknown:
            return ()
        return tuple(sorted({other for axis in unknown for other in self._beside[axis]}))

    def _limited(
        self,
        asked_v: Sequence[float],
        in_force_v: Sequence[float],
        elapsed_s: float,
        sent_v: Sequence[float] | None,
        slew_halved: Container[int],
    ) -> Admitted:
        """Return the voltages within range and slew rate; arguments as for `admit`."""
        # A time that is not finite, or negative, allows no motion.
        elapsed_s = min(max(elapsed_s, 0.0), self._longest_s) if isfinite(elapsed_s) else 0.0
        drive_v: list[float] = []
        unknown: list[int] = []
        refused: tuple[int, ...] = ()
        range_limited: tuple[int, ...] = ()
        slew_limited: tuple[int, ...] = ()
        for axis, limits in enumerate(self._limits):
            requested_v, previous_v = asked_v[axis], in_force_v[axis]
            if not (isfinite(requested_v) and isfinite(previous_v)):
                refused += (axis,)
                if not isfinite(previous_v):
                    unknown.append(axis)
                drive_v.append(previous_v)
                continue
            # Range first, then slew rate: a voltage that starts outside the range returns at the
            # slew rate.
            target_v = min(max(requested_v, limits.drive_min_v), limits.drive_max_v)
            reach_s = elapsed_s / 2.0 if axis in slew_halved else elapsed_s
            admitted_v = nearest(limits.window(previous_v, reach_s), target_v)
            # Either voltage may be in force: the second window makes the step small from both.
            if sent_v is not None and isfinite(sent_v[axis]):
                admitted_v = nearest(limits.window(sent_v[axis], reach_s), admitted_v)
            if target_v != requested_v:
                range_limited += (axis,)
            if admitted_v != target_v:
                slew_limited += (axis,)
            drive_v.append(admitted_v)
        held = self._together(unknown)
        return Admitted(drive_v, held, refused, range_limited, slew_limited, False)

    def _awaiting(
        self,
        admitted: Admitted,
        in_force_v: Sequence[float],
        read_back_v: Sequence[float],
        age_s: Sequence[float] | None,
    ) -> Admitted:
        """Return what may be written if each output is waited for that is out of reach."""
        drive_v, unknown = admitted.drive_v, [*admitted.held]
        waits: tuple[int, ...] = ()
        for axis, fresh_v in enumerate(self._fresh_v):
            aged_s = 0.0 if age_s is None else age_s[axis]
            reach_v = fresh_v + self._limits[axis].slew_v_per_s * aged_s
            # NaN compares false: without a finite read-back there is nothing to wait for.
            if reach_v < abs(drive_v[axis] - read_back_v[axis]) < inf:
                waits += (axis,)
                drive_v[axis] = in_force_v[axis]
                if not abs(in_force_v[axis] - read_back_v[axis]) <= reach_v:
                    unknown.append(axis)
        if waits:
            admitted.held, admitted.waits = self._together(unknown), waits
        return admitted
