"""Watches the amplifier of one axis: what it takes, and whether it does what it was told.

Detects A1, A3 to A9 and A11 to A13. A write that is refused, late or taken in part looks the same
from here: it is A1, and the driver's log tells more.
"""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.guard import Limits
from piezod.control.signals import LeakyBucket, RecentRange
from piezod.devices.status import DeviceFlag, Flags

FLAG_FAULTS: Final = {
    DeviceFlag.SHORT_OR_OPEN: Fault.A11,
    DeviceFlag.OVER_TEMPERATURE: Fault.A13,
    DeviceFlag.RESTARTED: Fault.A7,
    DeviceFlag.WATCHDOG_TRIPPED: Fault.A9,
    DeviceFlag.OVERLOAD: Fault.A4,
    DeviceFlag.LOCAL_MODE: Fault.A8,
}
"""What it means when an amplifier says so."""
MISMATCH_CYCLES: Final = 3
LAG_CYCLES: Final = 3
DELAYS: Final = 4
"""The output follows within so many cycles, and so many times the delay of the displacement."""
COLLAPSE_V: Final = 20.0
"""A voltage that is so much nearer to 0 after one cycle, untold, has collapsed."""
OVER_VOLTAGE_V: Final = 2.0
OVER_VOLTAGE_CYCLES: Final = 2
"""So far outside the range, for so long, is no overshoot."""
RANGE_CYCLES, SLEW_CYCLES = 20, 100
"""The drive may be limited for so long by its range and by its slew rate."""

_NOTHING: Final[Sequence[Detection]] = ()


class AmplifierWatch:
    """Watches one channel; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        limits: What its drive may do.
        delay_ns: How long the displacement lags behind the voltage; the output lags by no more.
        period_ns: Period of the loop.
        lag_ns: How much later than it was written a voltage is read back, where nobody waits for
            the amplifier.
    """

    def __init__(
        self, axis: int, limits: Limits, delay_ns: int, period_ns: int, lag_ns: int = 0
    ) -> None:
        self._axis = axis
        self._low_v, self._high_v = limits.drive_min_v, limits.drive_max_v
        self._tolerance_v = limits.read_back_tolerance_v
        self._written_v = RecentRange(LAG_CYCLES + (DELAYS * delay_ns + lag_ns) // period_ns)
        self._taken_v, self._read_back_v = nan, nan
        self._refusals = LeakyBucket()
        self._was_inside = False
        self._mismatched = self._outside = 0
        self._in_range_end = self._at_slew_rate = 0
        self._written = self._not_taken = self._not_finite = False
        self.overloaded = False
        """Whether the amplifier says so now."""
        self.strayed_v = nan
        """What is read back in this cycle where it is nothing that was written lately, in V; NaN
        where it is, or where the writes of some cycles have not changed it (A3)."""

    def check(self, read_back_v: float, flags: Flags) -> Sequence[Detection]:
        """Return what is wrong with the channel; call it once in each cycle, before the write.

        May be called in the loop. What is judged is the write of the cycle before.

        Args:
            read_back_v: Voltage that the amplifier tells is in force now, NaN where it does not.
            flags: What the device says is the matter.
        """
        if not self._written and self._taken_v == self._taken_v:
            self.forget()
        before_v, self._read_back_v = self._read_back_v, read_back_v
        self.overloaded = DeviceFlag.OVERLOAD in flags
        wrong = bool(flags) or self._not_taken or self._not_finite
        wrong |= self._in_range_end >= RANGE_CYCLES or self._at_slew_rate >= SLEW_CYCLES
        off_v = 0.0
        if read_back_v - read_back_v == 0.0:
            off_v = self._deviation_v(read_back_v)
            wrong |= self._is_over_voltage(read_back_v) or off_v > 0.0
        self.strayed_v = nan
        if not wrong:
            self._mismatched, self._written = 0, False
            return _NOTHING
        found = self._flagged(flags)
        found += self._of_write()
        found += self._of_read_back(read_back_v, before_v, off_v)
        self._written = False
        return found

    def wrote(
        self,
        drive_v: float,
        *,
        taken: bool,
        refused: bool = False,
        range_limited: bool = False,
        slew_limited: bool = False,
    ) -> None:
        """Learn what became of the write of this cycle; only where one was tried, not in shadow.

        May be called in the loop.

        Args:
            drive_v: Voltage that was sent, finite.
            taken: Whether the amplifier took it.
            refused: Whether the guard refused what was asked for, as not finite.
            range_limited: Whether more was wanted than the range allows.
            slew_limited: Whether more was wanted than the slew rate allows.
        """
        if self._taken_v != self._taken_v:  # not a number: the first write since `forget`
            known = self._read_back_v - self._read_back_v == 0.0
            self._taken_v = self._read_back_v if known else drive_v
            self._written_v.add(self._taken_v)
        self._written_v.add(drive_v)
        if taken:
            self._taken_v = drive_v
        else:  # whether it is in force nevertheless, nobody knows
            self._written_v.add(self._taken_v)
        self._written = True
        self._not_taken = self._refusals.update(not taken)
        self._not_finite = refused
        self._in_range_end = self._in_range_end + 1 if range_limited else 0
        self._at_slew_rate = self._at_slew_rate + 1 if slew_limited else 0

    def forget(self) -> None:
        """Forget what was written: from here on the amplifier is taken over from its read-back.

        May be called in the loop. A cycle in which nothing is written does the same.
        """
        self._written_v.forget()
        self._taken_v = self.strayed_v = nan
        self._refusals.reset()
        self._mismatched = self._in_range_end = self._at_slew_rate = 0
        self._written = self._not_taken = self._not_finite = False

    def _deviation_v(self, read_back_v: float) -> float:
        """Return how far it is from all that was written lately, beyond the tolerance."""
        if not self._written:
            return 0.0
        off_v = max(self._written_v.low - read_back_v, read_back_v - self._written_v.high)
        return off_v if off_v > self._tolerance_v else 0.0

    def _is_over_voltage(self, read_back_v: float) -> bool:
        if self._low_v <= read_back_v <= self._high_v:
            self._was_inside = True
        over = not self._low_v - OVER_VOLTAGE_V <= read_back_v <= self._high_v + OVER_VOLTAGE_V
        # A stage that was outside when it was taken over is brought back, not cut off.
        self._outside = self._outside + 1 if over and self._was_inside else 0
        return self._outside >= OVER_VOLTAGE_CYCLES

    def _flagged(self, flags: Flags) -> list[Detection]:
        return [Detection(id_, self._axis) for flag, id_ in FLAG_FAULTS.items() if flag in flags]

    def _of_write(self) -> list[Detection]:
        found = []
        if self._not_taken:
            found.append(Detection(Fault.A1, self._axis))
        if self._not_finite:
            found.append(Detection(Fault.A5, self._axis))
        if self._in_range_end >= RANGE_CYCLES:
            found.append(Detection(Fault.A6, self._axis, self._in_range_end, RANGE_CYCLES))
        elif self._at_slew_rate >= SLEW_CYCLES:
            found.append(Detection(Fault.A6, self._axis, self._at_slew_rate, SLEW_CYCLES))
        return found

    def _of_read_back(self, read_back_v: float, before_v: float, off_v: float) -> list[Detection]:
        found = []
        if self._outside >= OVER_VOLTAGE_CYCLES:
            end_v = self._low_v if read_back_v < self._low_v else self._high_v
            found.append(Detection(Fault.A12, self._axis, read_back_v, end_v))
        if off_v > COLLAPSE_V and abs(before_v) - abs(read_back_v) > COLLAPSE_V:
            found.append(Detection(Fault.A7, self._axis, off_v, COLLAPSE_V))
        self._mismatched = self._mismatched + 1 if off_v > 0.0 else 0
        if 0 < self._mismatched < MISMATCH_CYCLES:
            self.strayed_v = read_back_v
        if self._mismatched >= MISMATCH_CYCLES:
            found.append(Detection(Fault.A3, self._axis, off_v, self._tolerance_v))
        return found
