"""Watches the buses to the devices of one axis, by the flags of the devices: B1 to B15, A2, S10.

A flag that no retry can clear is a fault at once. Events that a healthy bus has now and then are
counted, and are a fault if they repeat. If a device only measures, the amplifier stays reachable:
the same flags are then other cases of the faults.
"""

from collections.abc import Sequence
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.cases import COUNTED_FLAGS, NOT_SENT, UNREACHABLE, Case
from piezod.control.faults.detection import Detection
from piezod.control.signals import LeakyBucket
from piezod.devices.status import DeviceFlag, Flags

AT_ONCE: Final = {
    DeviceFlag.DISCONNECTED: Fault.B1,
    DeviceFlag.OTHER_PATH: Fault.B2,
    DeviceFlag.BUS_OFF: Fault.B8,
    DeviceFlag.DEVICE_FAILURE: Fault.B10,
    DeviceFlag.WRONG_REQUEST: Fault.B10,
    DeviceFlag.FOREIGN_FRAME: Fault.B12,
    DeviceFlag.HALF_OPEN: Fault.B13,
    DeviceFlag.PORT_SHARED: Fault.B14,
    DeviceFlag.STUCK: Fault.B15,
    DeviceFlag.OTHER_DEVICE: Fault.S10,
}
"""Flags that are a fault in the first cycle that reports them."""
NOT_SENT_CYCLES: Final = 3
"""A frame that cannot be sent in this many cycles in a row is a fault: the bus is as good as
off."""

_NOTHING: Final[Sequence[Detection]] = ()


class _DeviceWatch:
    """Watches the device that has one role for an axis."""

    def __init__(self, axis: int, *, drives: bool) -> None:
        self._axis, self._drives = axis, drives
        self._buckets = {flag: LeakyBucket() for flag in COUNTED_FLAGS}
        self._not_sent_cycles = 0
        self.counting = False
        """Whether a counter is above zero."""

    def check(self, flags: Flags) -> list[Detection]:
        """Return the faults of the device, single events included."""
        found = [
            self._found(fault, self._case(flag, fault))
            for flag, fault in AT_ONCE.items()
            if flag in flags
        ]
        self.counting = False
        for flag, bucket in self._buckets.items():
            # Empty buckets without a flag need no update: most cycles end here.
            if flag in flags or bucket.level:
                found += self._counted(flag, bucket, flag in flags)
                self.counting |= bucket.level > 0
        self._not_sent_cycles = self._not_sent_cycles + 1 if DeviceFlag.NOT_SENT in flags else 0
        if self._not_sent_cycles:
            self.counting = True
            stalled = self._not_sent_cycles >= NOT_SENT_CYCLES
            # Frames that wait are counted in a row, not by a bucket: the transmit queue is either
            # stuck or not.
            case = self._case(DeviceFlag.NOT_SENT, NOT_SENT) if stalled else Case.SINGLE
            found.append(
                Detection(NOT_SENT, self._axis, self._not_sent_cycles, NOT_SENT_CYCLES, case)
            )
        return found

    def _counted(
        self, flag: DeviceFlag, bucket: LeakyBucket, reported: bool
    ) -> Sequence[Detection]:
        """Return the fault of a counted flag, or a single event."""
        fault = COUNTED_FLAGS[flag]
        if bucket.update(reported):
            return (self._found(fault, self._case(flag, fault)),)
        return (self._found(fault, Case.SINGLE),) if reported else ()

    def _found(self, fault: Fault, case: Case) -> Detection:
        return Detection(fault, self._axis, case=case)

    def _case(self, flag: DeviceFlag, fault: Fault) -> Case:
        """Return the case that a flag means for this role."""
        if flag is DeviceFlag.WRONG_REQUEST:
            return Case.REQUEST
        if flag is DeviceFlag.BUSY:
            return Case.BUSY
        if fault is Fault.S10 and self._drives:
            return Case.AMPLIFIER
        return Case.SENSOR if fault in UNREACHABLE and not self._drives else Case.USUAL


class BusWatch:
    """Watches the devices of one axis. Fixed memory. Real-time safe.

    Args:
        axis: Index of the axis, for the detections.
    """

    def __init__(self, axis: int) -> None:
        self._sensor, self._amplifier = (
            _DeviceWatch(axis, drives=False),
            _DeviceWatch(axis, drives=True),
        )
        self.explains_silence = False
        """Whether the sensor has a bus fault, so that missing samples are its consequence."""
        self.counting = False
        """Whether a counter is above zero, so that `check` must also be called without flags."""

    def check(self, sensor: Flags, amplifier: Flags) -> Sequence[Detection]:
        """Return the faults of both devices. Call once per cycle, after the read.

        Args:
            sensor: Flags that the device of the sensor reports.
            amplifier: Flags that the device of the amplifier reports; the same if it is the same
                device.
        """
        of_amplifier = self._amplifier.check(amplifier)
        of_sensor = self._sensor.check(sensor)
        self.explains_silence = any(one.case is not Case.SINGLE for one in of_sensor)
        self.counting = self._sensor.counting or self._amplifier.counting or self.explains_silence
        if not (of_amplifier or of_sensor):
            return _NOTHING
        # One device with both roles reports each fault twice: keep the amplifier's, which is the
        # worse case.
        reported = {one.fault for one in of_amplifier if one.case is not Case.SINGLE}
        return [*of_amplifier, *(one for one in of_sensor if one.fault not in reported)]
