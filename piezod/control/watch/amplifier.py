"""Watches the amplifier of one axis: its acknowledgements, its read-back and its flags.

Detects A1, A3 to A9 and A11 to A13. A write that is refused, late or incomplete looks the same here
and is A1; the log of the driver distinguishes them.
"""

from collections.abc import Sequence
from math import isnan, nan
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.guard import Limits
from piezod.control.signals import LeakyBucket, RecentRange
from piezod.devices.status import MOVED, DeviceFlag, Flags

FLAG_FAULTS: Final = {
    DeviceFlag.SHORT_OR_OPEN: Fault.A11,
    DeviceFlag.OVER_TEMPERATURE: Fault.A13,
    DeviceFlag.RESTARTED: Fault.A7,
    DeviceFlag.WATCHDOG_TRIPPED: Fault.A9,
    DeviceFlag.OVERLOAD: Fault.A4,
    DeviceFlag.LOCAL_MODE: Fault.A8,
}
"""Faults that an amplifier reports by a flag."""
MISMATCH_CYCLES: Final = 3
"""The read-back must differ in this many cycles in a row to be A3."""
LAG_CYCLES: Final = 3
LAG_DELAYS: Final = 4
"""The output follows within this many cycles plus this many delays of the displacement."""
COLLAPSE_V: Final = 20.0
"""A read-back that unexpectedly falls this much towards 0 V within one cycle has collapsed, in
V."""
OVER_VOLTAGE_V: Final = 2.0
OVER_VOLTAGE_CYCLES: Final = 2
"""An overshoot stays within this many volts of the range, or does not last this many cycles."""
RANGE_CYCLES, SLEW_CYCLES = 20, 100
"""The drive may be limited for this many cycles in a row by its range and by its slew rate."""

_NOTHING: Final[Sequence[Detection]] = ()


class AmplifierWatch:
    """Watches one amplifier channel. Fixed memory. Real-time safe.

    Args:
        axis: Index of the axis, for the detections.
        limits: Limits of the drive.
        delay_ns: Delay of the displacement behind the voltage, in ns; the output itself is faster.
        period_ns: Period of the loop, in ns.
        lag_ns: Extra delay of the read-back behind the write, in ns, if the loop does not wait for
            the amplifier.
    """

    def __init__(
        self, axis: int, limits: Limits, delay_ns: int, period_ns: int, lag_ns: int = 0
    ) -> None:
        self._axis = axis
        self._low_v, self._high_v = limits.drive_min_v, limits.drive_max_v
        self._tolerance_v = limits.read_back_tolerance_v
        self._written_v = RecentRange(LAG_CYCLES + (LAG_DELAYS * delay_ns + lag_ns) // period_ns)
        self._taken_v, self._read_back_v = nan, nan
        self._refusals = LeakyBucket()
        self._was_inside = False
        self._mismatch_cycles = self._outside_cycles = 0
        self._range_limited_cycles = self._slew_limited_cycles = 0
        self._written = self._not_taken = self._not_finite = False
        self._after_gap = False
        self.overloaded = False
        """Whether the amplifier reports an overload in this cycle."""
        self.follows = False
        """Whether the read-back of this cycle matches a recent write."""
        self.unexplained_fall = False
        """Whether the read-back has collapsed since the last write, and neither the amplifier was
        silent nor the loop stood still. The read-back itself may be wrong."""
        self.reports_move = False
        """Whether the amplifier has reported since the last acknowledged write that its output
        fell, or that it is in local mode: that write need not be in force."""
        self._is_local = self._had_flags = False

    def check(self, read_back_v: float, flags: Flags) -> Sequence[Detection]:
        """Return the faults of the channel. Call once per cycle, before the write.

        The write of the cycle before is judged.

        Args:
            read_back_v: Read-back voltage, in V; NaN if the amplifier does not report it.
            flags: Flags that the device reports.
        """
        # Nothing was written in the cycle before, as in SAFE: another program may drive the
        # amplifier now.
        if not self._written and self._taken_v == self._taken_v:
            self.forget()
        # Most cycles end with the early return below: what follows it may cost more.
        before_v, self._read_back_v = self._read_back_v, read_back_v
        wrong = (
            self._not_taken
            or self._not_finite
            or self._range_limited_cycles >= RANGE_CYCLES
            or self._slew_limited_cycles >= SLEW_CYCLES
        )
        if flags or self._had_flags:
            self._take_flags(flags)
            wrong = wrong or self._had_flags
        deviation_v, self.follows = 0.0, False
        if read_back_v - read_back_v == 0.0:
            if self._written:
                deviation_v = self._deviation_v(read_back_v)
                self.follows = deviation_v == 0.0
            if self._low_v <= read_back_v <= self._high_v:
                self._was_inside, self._outside_cycles = True, 0
            else:
                wrong = self._has_over_voltage(read_back_v) or wrong
            wrong = wrong or deviation_v > 0.0
        if self.unexplained_fall and isnan(read_back_v):
            self.unexplained_fall = False
        found = self._found(flags, read_back_v, before_v, deviation_v) if wrong else _NOTHING
        if self.follows:  # a cycle without a read-back shows nothing
            self._mismatch_cycles = 0
        self._written = self._after_gap = False
        return found

    def _take_flags(self, flags: Flags) -> None:
        """Take flags that are not those of the cycle before."""
        self._had_flags = bool(flags)
        self.overloaded = DeviceFlag.OVERLOAD in flags
        self._is_local = DeviceFlag.LOCAL_MODE in flags
        self.reports_move |= not MOVED.isdisjoint(flags)

    def after_gap(self, skipped: int) -> None:
        """Take the number of periods that were skipped just before this cycle."""
        self._after_gap = skipped >= MISMATCH_CYCLES

    def wrote(
        self,
        drive_v: float,
        *,
        taken: bool,
        refused: bool = False,
        range_limited: bool = False,
        slew_limited: bool = False,
    ) -> None:
        """Take the result of the write of this cycle. Not for cycles in shadow or without a write.

        Args:
            drive_v: Voltage that was sent, finite, in V.
            taken: Whether the amplifier acknowledged it.
            refused: Whether the guard refused a request that was not finite.
            range_limited: Whether the request exceeded the range.
            slew_limited: Whether the request exceeded the slew rate.
        """
        if self._taken_v != self._taken_v:  # NaN: the first write since `forget`
            known = self._read_back_v - self._read_back_v == 0.0
            self._taken_v = self._read_back_v if known else drive_v
            self._written_v.add(self._taken_v)
        self._written_v.add(drive_v)
        if taken:
            # In local mode an amplifier may acknowledge a write that it does not follow.
            self._taken_v, self.reports_move = drive_v, self._is_local
        else:  # without an acknowledgement either voltage may be in force
            self._written_v.add(self._taken_v)
        self._written, self.unexplained_fall = True, False
        self._not_taken = self._refusals.update(not taken)
        self._not_finite = refused
        self._range_limited_cycles = self._range_limited_cycles + 1 if range_limited else 0
        self._slew_limited_cycles = self._slew_limited_cycles + 1 if slew_limited else 0

    def waited(self, in_force_v: float) -> None:
        """Take a cycle without a write, because the output does not follow the last one.

        Args:
            in_force_v: Voltage that was written last, in V.
        """
        if self._taken_v != self._taken_v:  # NaN: no write since `forget`
            self.taken_over(in_force_v)
        self._written_v.add(in_force_v)  # earlier ones explain the read-back no longer
        self._written = True

    def taken_over(self, in_force_v: float) -> None:
        """Forget all writes: the amplifier is taken over at a voltage, in V."""
        self.forget()
        self._taken_v = in_force_v
        self._written_v.add(in_force_v)

    def forget(self) -> None:
        """Forget all writes: the amplifier is taken over from its read-back.

        A cycle without a write does the same. `reports_move` stays: it tells how to take over.
        """
        self._written_v.forget()
        self._taken_v = nan
        self._refusals.reset()
        self._mismatch_cycles = self._range_limited_cycles = self._slew_limited_cycles = 0
        self._written = self._not_taken = self._not_finite = False

    def _deviation_v(self, read_back_v: float) -> float:
        """Return how far the read-back is from all recent writes, in V; 0 within the tolerance."""
        deviation_v = max(self._written_v.low - read_back_v, read_back_v - self._written_v.high)
        return deviation_v if deviation_v > self._tolerance_v else 0.0

    def _has_over_voltage(self, read_back_v: float) -> bool:
        """Return whether a read-back outside the range has been there for too long."""
        over = not self._low_v - OVER_VOLTAGE_V <= read_back_v <= self._high_v + OVER_VOLTAGE_V
        # A stage that was outside its range when it was taken over is brought back, not cut off.
        self._outside_cycles = self._outside_cycles + 1 if over and self._was_inside else 0
        return self._outside_cycles >= OVER_VOLTAGE_CYCLES

    def _found(
        self, flags: Flags, read_back_v: float, before_v: float, deviation_v: float
    ) -> list[Detection]:
        """Return all faults of this cycle."""
        found = self._flag_faults(flags) + self._write_faults()
        return found + self._read_back_faults(read_back_v, before_v, deviation_v)

    def _flag_faults(self, flags: Flags) -> list[Detection]:
        """Return the faults that the amplifier reports by a flag."""
        return [
            Detection(fault, self._axis) for flag, fault in FLAG_FAULTS.items() if flag in flags
        ]

    def _write_faults(self) -> list[Detection]:
        """Return the faults of the last writes."""
        found = []
        if self._not_taken:
            found.append(Detection(Fault.A1, self._axis))
        if self._not_finite:
            found.append(Detection(Fault.A5, self._axis))
        if self._range_limited_cycles >= RANGE_CYCLES:
            found.append(Detection(Fault.A6, self._axis, self._range_limited_cycles, RANGE_CYCLES))
        elif self._slew_limited_cycles >= SLEW_CYCLES:
            found.append(Detection(Fault.A6, self._axis, self._slew_limited_cycles, SLEW_CYCLES))
        return found

    def _read_back_faults(
        self, read_back_v: float, before_v: float, deviation_v: float
    ) -> list[Detection]:
        """Return the faults of the read-back."""
        found = []
        if self._outside_cycles >= OVER_VOLTAGE_CYCLES:
            end_v = self._low_v if read_back_v < self._low_v else self._high_v
            found.append(Detection(Fault.A12, self._axis, read_back_v, end_v))
        # A collapse needs a large step towards 0 V, too; otherwise the output is stuck (A3). In a
        # gap of the loop the output had time to fall by a watchdog of the device: any fall counts.
        least_v = 0.0 if self._after_gap else COLLAPSE_V
        if deviation_v > least_v and abs(before_v) - abs(read_back_v) > least_v:
            found.append(Detection(Fault.A7, self._axis, deviation_v, least_v or self._tolerance_v))
            self.unexplained_fall = not self._after_gap
        self._mismatch_cycles += deviation_v > 0.0
        if self._mismatch_cycles >= MISMATCH_CYCLES:
            found.append(Detection(Fault.A3, self._axis, deviation_v, self._tolerance_v))
        return found
