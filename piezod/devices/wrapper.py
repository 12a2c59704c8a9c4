"""Wrappers of a device: every call is forwarded, except those that a subclass changes."""

from collections.abc import Sequence
from math import nan
from typing import Protocol, cast

from piezod.devices.interface import (
    Amplifier,
    Capabilities,
    Device,
    Exchanges,
    Identity,
    Sample,
    Sensor,
)
from piezod.devices.status import NO_FLAGS, Flags, TellsStatus


class AnyDevice(Sensor, Amplifier, Exchanges, TellsStatus, Protocol):
    """A device in every role; the caller of a method has checked that the device has that role."""


class DeviceWrapper:
    """Implements the roles of a device by forwarding every call."""

    def __init__(self, device: Device) -> None:
        self._device = cast("AnyDevice", device)
        self._able = able = device.capabilities()
        self._told_lag_ns = able.lag_ns
        # Made once: calls in the loop return these lists.
        self._unknown = [nan] * len(able.outputs)
        self._no_flags = [NO_FLAGS] * (len(able.inputs) + len(able.outputs))
        self._has_status = isinstance(device, TellsStatus)

    def open(self) -> Identity:
        """Open the device; it refuses, because it is open already."""
        return self._device.open()

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the device."""
        return self._able

    def activate(self, now_ns: int) -> None:
        """Activate the device."""
        self._device.activate(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device. Never raises."""
        self._device.deactivate(now_ns)

    def close(self) -> None:
        """Close the device. Never raises."""
        self._device.close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return a sample of each input. Real-time safe."""
        return self._device.read(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output. Real-time safe."""
        return self._device.write(drive_v, now_ns)

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Set every output and read every input in one exchange. Real-time safe."""
        return self._device.exchange(drive_v, now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back value of each output. Real-time safe."""
        return self._device.read_back(now_ns)

    def read_back_age_ns(self, now_ns: int) -> int:
        """Return the age of the last read-back, in ns: its delay, as the driver tells it.

        It counts from the cycle that made the first value which the read-back cannot show.
        Real-time safe.
        """
        if isinstance(self._device, DeviceWrapper):
            return self._device.read_back_age_ns(now_ns)
        return self._told_lag_ns

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of each channel. Real-time safe."""
        return self._device.status(now_ns) if self._has_status else self._no_flags

    def forget(self) -> None:
        """Drop what was read before: only what is read from now on counts. Real-time safe."""
        if isinstance(self._device, DeviceWrapper):
            self._device.forget()

    def _no_samples(self, now_ns: int) -> Sequence[Sample]:
        return [Sample(now_ns, nan, False)] * len(self._able.inputs)


class CombinedExchange(DeviceWrapper):
    """Uses one exchange with the device per cycle: the write of a cycle also reads.

    The samples and read-back values of a cycle are those of the exchange of the cycle before. If
    nothing was written since the last read, the device is asked.

    Args:
        device: The device, open; it implements `Exchanges`.
    """

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self._samples: Sequence[Sample] | None = None
        self._values: Sequence[float] | None = None

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return the samples of the last exchange once, or ask the device. Real-time safe."""
        # Once only: a second read without a write in between would return an old sample as new.
        samples, self._samples = self._samples, None
        return self._device.read(now_ns) if samples is None else samples

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output, and store the samples of the same exchange. Real-time safe."""
        accepted, self._samples = self._device.exchange(drive_v, now_ns)
        self._values = self._device.read_back(now_ns)  # from the exchange, without a further one
        return accepted

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back values of the last exchange once, or ask. Real-time safe."""
        values, self._values = self._values, None
        return self._device.read_back(now_ns) if values is None else values

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device, and drop the stored values, which get old. Never raises."""
        self.forget()
        super().deactivate(now_ns)

    def forget(self) -> None:
        """Drop the stored values: they are from before. Real-time safe."""
        self._samples = self._values = None
        super().forget()
