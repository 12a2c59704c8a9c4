"""A device that is opened again by a thread where it is lost; the loop goes on without it."""

import threading
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.interface import Device, Identity, Sample, is_same
from piezod.devices.status import DeviceFlag, Flags
from piezod.devices.waits import FIRST_WAIT_S, LONGEST_WAIT_S, waits_s
from piezod.devices.wrapper import DeviceWrapper
from piezod.errors import DeviceError


@runtime_checkable
class CanBeLost(Protocol):
    """A device that may be lost, and then is so until it is closed and opened again.

    Attributes:
        lost: Why nothing is tried any more, for people; empty where the device is there.
    """

    lost: str


class ReconnectingDevice(DeviceWrapper):
    """Passes calls on to a device as long as it is there, and opens it again where it is lost.

    While it is away samples are not valid, writes are refused, and what is in force is not known;
    nobody waits. What comes back is used only if it is who it was. If it is to be active, its
    outputs are taken over as they are; else it is deactivated.

    Args:
        device: The device, open and active; it implements `CanBeLost`.
        identity: Who it is.
        first_wait_s: How long to leave it alone after it was lost.
        longest_wait_s: How long at most between two tries.
    """

    def __init__(
        self,
        device: Device,
        identity: Identity,
        *,
        first_wait_s: float = FIRST_WAIT_S,
        longest_wait_s: float = LONGEST_WAIT_S,
    ) -> None:
        super().__init__(device)
        if not isinstance(device, CanBeLost):
            raise DeviceError(f"{identity.model} cannot be lost: it need not be tended")
        self._link: CanBeLost = device
        self._identity = identity
        self._waits_s = first_wait_s, longest_wait_s
        # The device belongs to the loop while it is there, and to the thread while it is not.
        self._there = True
        # What it is to be, which is the loop's to say, and what it was made last by its owner.
        self._wanted, self._active = True, True
        self._now_ns = 0
        self._untold: Sequence[Flags] | None = None
        self._gone = self._while_away = self._no_flags
        self._lost, self._ended = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self._tend, name="tending", daemon=True)
        """What opens the device again; to be started by whoever made this."""
        self.absent = ""
        """Why the last attempt to open it again failed; empty where none has, or it is there."""

    @property
    def there(self) -> bool:
        """Whether the device is there."""
        return self._there

    def activate(self, now_ns: int) -> None:
        """Activate the device, now or when it comes back.

        Raises:
            DeviceError: If it is there and refuses.
        """
        self._wanted = True
        if self._there:
            self._settle_here(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device, now or when it comes back. Never raises."""
        self._wanted = False
        if self._there:
            self._settle_here(now_ns)

    def close(self) -> None:
        """Close the device, and end the thread. Never raises."""
        self._ended.set()
        self._lost.set()
        if self.thread.is_alive():
            self.thread.join()
        super().close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Take a sample of each input; may be called in the loop."""
        if not self._is_there(now_ns):
            return self._no_samples(now_ns)
        samples = super().read(now_ns)
        self._look(now_ns)
        return samples

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output; may be called in the loop."""
        if not self._is_there(now_ns):
            return False
        taken = super().write(drive_v, now_ns)
        self._look(now_ns)
        return taken

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Set every output and read every input at once; may be called in the loop."""
        if not self._is_there(now_ns):
            return False, self._no_samples(now_ns)
        answer = super().exchange(drive_v, now_ns)
        self._look(now_ns)
        return answer

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell what is in force on each output; may be called in the loop."""
        if not self._is_there(now_ns):
            return self._unknown
        told_v = super().read_back(now_ns)
        self._look(now_ns)
        return told_v

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what is the matter with each channel; may be called in the loop."""
        if self._untold is not None:  # what was said when it was lost, once
            untold, self._untold = self._untold, None
            return untold
        return super().status(now_ns) if self._is_there(now_ns) else self._while_away

    def _is_there(self, now_ns: int) -> bool:
        self._now_ns = now_ns
        if self._there and self._wanted is not self._active:  # said while the thread was at it
            self._settle_here(now_ns)
        return self._there

    def _settle_here(self, now_ns: int) -> None:
        """Have the device be what it is to be; where it is lost over that, the thread does it.

        Raises:
            DeviceError: If it refuses; then it is to be what it is.
        """
        try:
            self._settle(now_ns)
        except Exception:
            self._look(now_ns)
            if self._there:
                self._wanted = self._active
                raise
        else:
            self._look(now_ns)

    def _settle(self, now_ns: int) -> None:
        wanted = self._wanted
        if wanted:
            self._device.activate(now_ns)
        else:
            self._device.deactivate(now_ns)
        self._active = wanted

    def _look(self, now_ns: int) -> None:
        """Leave the device to the thread where it has just been lost."""
        if not self._link.lost:
            return
        told = super().status(now_ns)
        self._gone = [each & LOSING or frozenset({DeviceFlag.DISCONNECTED}) for each in told]
        self._untold, self._while_away = told, self._gone
        self._there = False
        self._lost.set()

    def _tend(self) -> None:
        while not self._ended.is_set():
            self._lost.wait()
            if not self._there:
                self._open_again()

    def _open_again(self) -> None:
        self._let_go()
        for wait_s in waits_s(*self._waits_s):
            if self._ended.wait(wait_s):
                return
            if self._came_back():
                self._lost.clear()
                self._there = True
                return

    def _came_back(self) -> bool:
        """Open the device; return whether that went well and it is who it was."""
        self._while_away = self._gone
        try:
            found = self._device.open()
            if is_same(found, self._identity):
                self._settle(self._now_ns)
                self.absent = ""
                return True
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way; it is tried again
            self.absent = str(error)
        else:
            who, wanted = (" ".join(one) for one in (found, self._identity))
            self.absent = f"another device came back: {who}, expected: {wanted}"
            self._while_away = [each | {DeviceFlag.OTHER_DEVICE} for each in self._gone]
        self._let_go()
        return False

    def _let_go(self) -> None:
        """Close the device; if its driver fails at that, it is opened again all the same."""
        try:
            super().close()
        except Exception as error:  # noqa: BLE001 - it must not end the thread
            self.absent = self.absent or str(error)
