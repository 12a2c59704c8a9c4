"""The output of one axis: what was written last, and which voltage is in force."""

from collections.abc import Callable
from math import isfinite, nan
from typing import Final

from piezod.commission.device_watch import PATIENCE_S
from piezod.control.in_force import Claim, Evidence, fell, voltage_in_force
from piezod.daemon.clock import Clock
from piezod.devices.channels import Channels
from piezod.devices.status import MOVED
from piezod.errors import DeviceError
from piezod.units import s_to_ns

POLL_S: Final = 0.01
"""Pause between two read-backs while one is waited for, in s."""


class Output:
    """Writes to one axis, and asks the judge for the voltage in force.

    Args:
        channels: The devices, of this one axis; they are open and active.
        tolerance_v: Allowed difference between read-back and written voltage, in V.
        clock: The clock.
        last_v: Voltage that was written last, in V, by whoever drove the axis before; NaN if that
            is not known, or if a person answers for the read-back. Without a read-back, the voltage
            in force, as a person has seen it.
        rest_v: Voltage to which a watchdog of the device brings the output, in V; NaN without one.
        note: Called with each voltage before it is written, in V.
    """

    def __init__(
        self,
        channels: Channels,
        tolerance_v: float,
        clock: Clock,
        last_v: float = nan,
        rest_v: float = nan,
        note: Callable[[float], object] = float,
    ) -> None:
        self._channels, self._tolerance_v, self._clock = channels, tolerance_v, clock
        self._rest_v, self._note = rest_v, note
        self._reads_back = channels.capabilities().read_back
        self.drive_v = last_v
        """Last acknowledged write, or the voltage that was found in force, in V."""
        self.sent_v = nan
        """Voltage that was sent later and not acknowledged, in V; NaN if there is none."""

    def read_back_v(self, now_ns: int) -> float:
        """Return the read-back, in V; NaN if there is none."""
        return self._channels.read_back(now_ns)[0] if self._reads_back else nan

    def write(self, drive_v: float, now_ns: int) -> bool:
        """Write a voltage, in V; return whether it was accepted."""
        self._note(drive_v)
        accepted = self._channels.write([drive_v], now_ns)
        if accepted:
            self.drive_v, self.sent_v = drive_v, nan
        else:
            self.sent_v = drive_v
        return accepted

    def find(self) -> None:
        """Find the voltage in force: it is `drive_v` from now on.

        Raises:
            DeviceError: If it is unknown: the amplifier reports none, or one that contradicts the
                last write.
        """
        if not self._reads_back:
            if isfinite(self.drive_v):
                return
            raise DeviceError(
                "the voltage in force is unknown: the amplifier does not read back; give it with "
                "`piezod commission --output-v`"
            )
        read_back_v = self._settled_v()
        *_, flags = self._channels.status(self._clock.now_ns())  # of the amplifier, not the sensor
        written_v = self._written_v(read_back_v)
        known = Evidence(
            Claim(read_back_v),
            Claim(written_v),
            reports_move=not MOVED.isdisjoint(flags),
            explained=fell(read_back_v, written_v, self._rest_v),
        )
        found = voltage_in_force(known, self._tolerance_v)
        if not isfinite(found.drive_v):
            raise DeviceError(
                f"the voltage is left as it is: {found.doubt}; look at the amplifier: if its "
                "output is at its read-back, `piezod commission --confirm-output` starts there, "
                "and `piezod safe --confirm-output` ramps the stage down from there"
            )
        self.drive_v, self.sent_v = found.drive_v, nan

    def _written_v(self, read_back_v: float) -> float:
        """Return the last write, in V: also one without acknowledgement, if it is in force."""
        agrees = abs(read_back_v - self.sent_v) <= self._tolerance_v
        return self.sent_v if agrees else self.drive_v

    def _settled_v(self) -> float:
        """Return the read-back voltage, in V; wait until it is finite and at the last write.

        Raises:
            DeviceError: If none is finite. One that stays elsewhere is returned.
        """
        shown_v, end_ns = nan, self._clock.now_ns() + s_to_ns(PATIENCE_S)
        while (now_ns := self._clock.now_ns()) <= end_ns:
            read_back_v = self.read_back_v(now_ns)
            if isfinite(read_back_v):
                shown_v = read_back_v
                # Without a known last write the difference is NaN, and the comparison false.
                if not abs(shown_v - self._written_v(shown_v)) > self._tolerance_v:
                    return shown_v
            self._clock.sleep_until_ns(now_ns + s_to_ns(POLL_S))
        if isfinite(shown_v):
            return shown_v
        raise DeviceError(
            f"the voltage in force is unknown: the amplifier has reported none for {PATIENCE_S:g} s"
        )
