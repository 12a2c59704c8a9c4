"""What is put around a device: every call goes through to it, but for those that differ."""

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
    """A device in every role; whoever asks for one of them has made sure that it plays it."""


class DeviceWrapper:
    """Implements the roles of a device over it.

    Args:
        device: The device, open.
    """

    def __init__(self, device: Device) -> None:
        self._device = cast("AnyDevice", device)
        self._able = able = device.capabilities()
        self._unknown = [nan] * len(able.outputs)
        self._no_flags = [NO_FLAGS] * (len(able.inputs) + len(able.outputs))
        self._tells = isinstance(device, TellsStatus)

    def open(self) -> Identity:
        """Open the device; it refuses, being open."""
        return self._device.open()

    def capabilities(self) -> Capabilities:
        """Tell what the device can do."""
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
        """Take a sample of each input; may be called in the loop."""
        return self._device.read(now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output; may be called in the loop."""
        return self._device.write(drive_v, now_ns)

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Set every output and read every input at once; may be called in the loop."""
        return self._device.exchange(drive_v, now_ns)

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell what is in force on each output; may be called in the loop."""
        return self._device.read_back(now_ns)

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what is the matter with each channel; may be called in the loop."""
        return self._device.status(now_ns) if self._tells else self._no_flags

    def _no_samples(self, now_ns: int) -> Sequence[Sample]:
        return [Sample(now_ns, nan, False)] * len(self._able.inputs)


class CombinedExchange(DeviceWrapper):
    """Has a cycle cost one exchange with the device: reading rides on the write before it.

    The samples of a cycle are those that came with the write of the cycle before, and so is what is
    in force. Where nothing was written since, they are asked for.

    Args:
        device: The device, open; it implements `Exchanges`.
    """

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self._came: Sequence[Sample] | None = None
        self._in_force: Sequence[float] | None = None

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Give what came with the last write, or take a sample; may be called in the loop."""
        came, self._came = self._came, None
        return self._device.read(now_ns) if came is None else came

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output, and keep what comes with it; may be called in the loop."""
        taken, self._came = self._device.exchange(drive_v, now_ns)
        self._in_force = self._device.read_back(now_ns)  # what the exchange told is not asked for
        return taken

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell what was in force after the last write, or ask; may be called in the loop."""
        told, self._in_force = self._in_force, None
        return self._device.read_back(now_ns) if told is None else told

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device, and forget what came. Never raises."""
        self._came = self._in_force = None
        super().deactivate(now_ns)
