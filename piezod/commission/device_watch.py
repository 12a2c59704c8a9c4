"""Ends a step of a session if its devices do not follow."""

from math import inf
from typing import Final

from piezod.control.signals import RecentRange
from piezod.devices.status import MOVED, DeviceFlag
from piezod.errors import DeviceError
from piezod.units import NS_PER_S

PATIENCE_S: Final = 2.0
"""Longest time, in s, for which refused writes are tolerated; a lost reply is over by then."""
OFF_CYCLES: Final = 50
"""Number of cycles with a wrong read-back voltage that ends a step."""
ENDING: Final = MOVED | {
    DeviceFlag.OVERLOAD,
    DeviceFlag.OVER_TEMPERATURE,
    DeviceFlag.SHORT_OR_OPEN,
}
"""Flags of a device that end a step."""


class DeviceWatch:
    """Ends a step if the devices do not follow within a tolerance, or later than a lag allows."""

    def __init__(self, tolerance_v: float, lag_cycles: int) -> None:
        self._tolerance_v, self._written_v = tolerance_v, RecentRange(lag_cycles)
        self._refused_ns = self._waits_ns = self._off = 0

    def check_read_back(
        self, read_back_v: float, drive_v: float, flags: frozenset[DeviceFlag]
    ) -> None:
        """Check the read-back voltage, NaN if there is none, and the flags of the devices."""
        if wrong := flags & ENDING:
            raise DeviceError(f"the device reports: {', '.join(sorted(wrong))}")
        self._written_v.add(drive_v)
        # Distance to the range of recently written voltages: an amplifier may follow late.
        off_v = max(read_back_v - self._written_v.high, self._written_v.low - read_back_v)
        # Without read-back the distance is NaN and the comparison false.
        self._off = self._off + 1 if self._tolerance_v < off_v < inf else 0
        if self._off >= OFF_CYCLES:
            raise DeviceError(
                f"the read-back voltage differs by {read_back_v - drive_v:.1f} V from the written "
                "one: check the calibration of the channel, the load, and whether another program "
                "drives the amplifier"
            )

    def check_wait(self, read_back_v: float, drive_v: float, now_ns: int, *, waits: bool) -> None:
        """Check for how long the output has not followed its writes."""
        if not waits:
            self._waits_ns = 0
            return
        self._waits_ns = self._waits_ns or now_ns
        if (now_ns - self._waits_ns) / NS_PER_S > PATIENCE_S:
            raise DeviceError(
                f"the output does not follow its writes: {drive_v:.2f} V written, "
                f"{read_back_v:.2f} V read back: check the load and the calibration of the channel"
            )

    def check_write(self, *, accepted: bool, drive_v: float, now_ns: int) -> None:
        """Check for how long writes have been refused."""
        if accepted:
            self._refused_ns = 0
            return
        self._refused_ns = self._refused_ns or now_ns
        refused_s = (now_ns - self._refused_ns) / NS_PER_S
        if refused_s > PATIENCE_S:
            raise DeviceError(f"the amplifier has refused {drive_v:.2f} V for {refused_s:.1f} s")
