"""Watches the way to the devices of one axis: B1 to B15, and A2 and S10, from what they tell.

What cannot be mended by trying again is a fault at once. What a bus may do now and then is only
counted, and is a fault where it happens again and again. A device that only measures can be lost
without losing the amplifier: the same faults are then other cases.
"""

from collections.abc import Sequence
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.cases import COUNTED_FLAGS, LOST, NOT_SENT, Case
from piezod.control.faults.register import Detection
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
"""One of these is a fault in the cycle in which it is told."""
NOT_SENT_CYCLES: Final = 3
"""For so many cycles in a row a frame could not be sent: the bus is as good as off."""

_NOTHING: Final[Sequence[Detection]] = ()


class _Side:
    """Watches the device that plays one role for an axis."""

    def __init__(self, axis: int, *, drives: bool) -> None:
        self._axis, self._drives = axis, drives
        self._buckets = {flag: LeakyBucket() for flag in COUNTED_FLAGS}
        self._not_sent = 0
        self.counting = False
        """Whether a count is not yet back at zero."""

    def check(self, flags: Flags) -> list[Detection]:
        found = [
            self._found(fault, self._case(flag, fault))
            for flag, fault in AT_ONCE.items()
            if flag in flags
        ]
        self.counting = False
        for flag, bucket in self._buckets.items():
            if flag in flags or bucket.level:
                found += self._counted(flag, bucket, flag in flags)
                self.counting |= bucket.level > 0
        self._not_sent = self._not_sent + 1 if DeviceFlag.NOT_SENT in flags else 0
        if self._not_sent:
            self.counting = True
            stalled = self._not_sent >= NOT_SENT_CYCLES
            case = self._case(DeviceFlag.NOT_SENT, NOT_SENT) if stalled else Case.SINGLE
            found.append(Detection(NOT_SENT, self._axis, self._not_sent, NOT_SENT_CYCLES, case))
        return found

    def _counted(self, flag: DeviceFlag, bucket: LeakyBucket, told: bool) -> Sequence[Detection]:
        fault = COUNTED_FLAGS[flag]
        if bucket.update(told):
            return (self._found(fault, self._case(flag, fault)),)
        return (self._found(fault, Case.SINGLE),) if told else ()

    def _found(self, fault: Fault, case: Case) -> Detection:
        return Detection(fault, self._axis, case=case)

    def _case(self, flag: DeviceFlag, fault: Fault) -> Case:
        if flag is DeviceFlag.WRONG_REQUEST:
            return Case.REQUEST
        if flag is DeviceFlag.BUSY:
            return Case.BUSY
        if fault is Fault.S10 and self._drives:
            return Case.AMPLIFIER
        return Case.SENSOR if fault in LOST and not self._drives else Case.USUAL


class BusWatch:
    """Watches the devices of one axis; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
    """

    def __init__(self, axis: int) -> None:
        self._sensor, self._amplifier = _Side(axis, drives=False), _Side(axis, drives=True)
        self.explains_silence = self.counting = False
        """Whether the way to the sensor is so troubled that no sample is its consequence; whether
        a count is not yet back at zero, so that `check` has to be called."""

    def check(self, sensor: Flags, amplifier: Flags) -> Sequence[Detection]:
        """Return what is wrong on the way; call it once in each cycle, after the read.

        May be called in the loop.

        Args:
            sensor: What the sensor's device says is the matter.
            amplifier: What the amplifier's device says; the same where they are one.
        """
        of_amplifier = self._amplifier.check(amplifier)
        of_sensor = self._sensor.check(sensor)
        self.explains_silence = any(one.case is not Case.SINGLE for one in of_sensor)
        self.counting = self._sensor.counting or self._amplifier.counting or self.explains_silence
        if not (of_amplifier or of_sensor):
            return _NOTHING
        told = {one.fault for one in of_amplifier if one.case is not Case.SINGLE}
        return [*of_amplifier, *(one for one in of_sensor if one.fault not in told)]
