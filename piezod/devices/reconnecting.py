"""A device that a thread opens again after its loss; the loop runs on without it.

A device that answers nothing any more counts as lost, too: its time-outs would delay each cycle.
"""

import threading
from collections.abc import Sequence
from math import isfinite
from typing import Final, Protocol, runtime_checkable

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.interface import Device, Identity, Sample, is_same
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.devices.waits import FIRST_WAIT_S, LONGEST_WAIT_S, waits_s
from piezod.devices.wrapper import DeviceWrapper
from piezod.errors import DeviceError, PortHeldError
from piezod.units import NS_PER_S

SILENT_NS: Final = NS_PER_S // 2
SILENT_CYCLES: Final = 5
"""A device is lost if it answers nothing for this time, in ns, and in so many cycles."""


@runtime_checkable
class CanBeLost(Protocol):
    """A device that may be lost, until it is closed and opened again."""

    lost: str  #: Reason of the loss, for people; empty if the device is connected.


class ReconnectingDevice(DeviceWrapper):
    """Forwards calls to a device while it is connected, and opens it again after a loss.

    While the device is lost, samples are invalid, writes are refused and read-back values are NaN;
    no call waits. Its flags then tell, too, if another program holds its port, or if another device
    was found. The opened device is used only if its identity is the same as before. If it is to be
    active, its outputs are taken over as they are; otherwise it is deactivated.

    Args:
        device: The device, open and active; it implements `CanBeLost`.
        identity: Its identity.
        first_wait_s: Wait before the first attempt to open it again, in s.
        longest_wait_s: Longest wait between two attempts, in s.
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
            raise DeviceError(f"{identity.model} cannot be lost: it needs no reconnection")
        self._link: CanBeLost = device
        self._identity = identity
        self._waits_s = first_wait_s, longest_wait_s
        # Ownership: the loop uses the device while it is connected, the thread while it is lost.
        self._there = True
        # The mode that the loop requests, and the mode that the present owner set last.
        self._wanted, self._active = True, True
        self._now_ns = 0
        self._flags_at_loss: Sequence[Flags] | None = None
        self._lost_flags = self._flags_while_lost = self._no_flags
        self._silence = _Silence()
        self._lost, self._ended = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self._reconnect, name="reconnect", daemon=True)
        """Thread that opens the device again; the creator of this object starts it."""
        self.absent = ""
        """Why the last attempt to open it failed; empty if none failed, or it is connected."""
        self.obstacle: DeviceFlag | None = None
        """Flag that this attempt adds to those of the loss; None if it adds none."""

    @property
    def there(self) -> bool:
        """Whether the device is connected."""
        return self._there

    def activate(self, now_ns: int) -> None:
        """Activate the device, now or after it is opened again.

        Raises:
            DeviceError: If it is connected and refuses.
        """
        self._wanted = True
        if self._there:
            self._apply_wanted(now_ns)

    def deactivate(self, now_ns: int) -> None:
        """Deactivate the device, now or after it is opened again. Never raises."""
        self._wanted = False
        if self._there:
            self._apply_wanted(now_ns)

    def close(self) -> None:
        """Close the device and end the thread. Never raises."""
        self._ended.set()
        self._lost.set()  # wakes the thread, which then finds that it has to end
        if self.thread.is_alive():
            self.thread.join()
        super().close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return a sample of each input. Real-time safe."""
        if not self._is_there(now_ns):
            return self._no_samples(now_ns)
        samples = super().read(now_ns)
        self._silence.answered |= any(sample.valid for sample in samples)
        self._check_lost(now_ns)
        return samples

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Set every output. Real-time safe."""
        if not self._is_there(now_ns):
            return False
        accepted = super().write(drive_v, now_ns)
        self._silence.answered |= accepted
        self._check_lost(now_ns)
        return accepted

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Set every output and read every input in one exchange. Real-time safe."""
        if not self._is_there(now_ns):
            return False, self._no_samples(now_ns)
        answer = super().exchange(drive_v, now_ns)
        self._silence.answered |= answer[0]
        self._check_lost(now_ns)
        return answer

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back value of each output. Real-time safe."""
        if not self._is_there(now_ns):
            return self._unknown
        values = super().read_back(now_ns)
        # Without a read-back the values are the written ones, whether it answers or not.
        self._silence.answered |= self._able.read_back and any(map(isfinite, values))
        self._check_lost(now_ns)
        return values

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of each channel. Real-time safe."""
        if self._flags_at_loss is not None:  # reported once, then only the lasting ones
            flags, self._flags_at_loss = self._flags_at_loss, None
            return flags
        if not self._is_there(now_ns):
            return self._flags_while_lost
        flags = super().status(now_ns)
        if self._silence.lasts(flags, now_ns):
            self._hand_over(flags)
            self._flags_at_loss = None  # they are returned here
            return [each | lost for each, lost in zip(flags, self._lost_flags, strict=True)]
        return flags

    def _is_there(self, now_ns: int) -> bool:
        self._now_ns = now_ns
        # The request may have changed while the thread was opening the device.
        if self._there and self._wanted is not self._active:
            self._apply_wanted(now_ns)
        return self._there

    def _apply_wanted(self, now_ns: int) -> None:
        """Bring the device into the requested mode; if it gets lost, the thread does it later.

        Raises:
            DeviceError: If it refuses; the requested mode is then the present one.
        """
        try:
            self._set_mode(now_ns)
        except Exception:
            self._check_lost(now_ns)
            if self._there:
                self._wanted = self._active
                raise
        else:
            self._check_lost(now_ns)

    def _set_mode(self, now_ns: int) -> None:
        wanted = self._wanted
        if wanted:
            self._device.activate(now_ns)
        else:
            self._device.deactivate(now_ns)
        self._active = wanted

    def _check_lost(self, now_ns: int) -> None:
        """Hand the device over to the thread if it has just been lost."""
        if not self._link.lost:
            return
        self._hand_over(super().status(now_ns))

    def _hand_over(self, flags: Sequence[Flags]) -> None:
        """Hand the device over to the thread."""
        self._lost_flags = [each & LOSING or frozenset({DeviceFlag.DISCONNECTED}) for each in flags]
        self._flags_at_loss, self._flags_while_lost = flags, self._lost_flags
        # The order matters: from here on the loop must not touch the device.
        self._there = False
        self._lost.set()

    def _reconnect(self) -> None:
        while not self._ended.is_set():
            self._lost.wait()
            if not self._there:
                self._open_again()

    def _open_again(self) -> None:
        self._release()
        for wait_s in waits_s(*self._waits_s):  # endless, unless closed or opened
            if self._ended.wait(wait_s):
                return
            if self._try_to_open():
                # The reverse order of `_check_lost`: from here on the loop owns the device.
                self._lost.clear()
                self._there = True
                return

    def _try_to_open(self) -> bool:
        """Open the device; return whether that succeeded and its identity is the same."""
        try:
            found = self._device.open()
            if is_same(found, self._identity):
                self._set_mode(self._now_ns)
                self.absent, self.obstacle = "", None
                return True
        except Exception as error:  # noqa: BLE001 - any failure of a driver leads to the next attempt
            held = isinstance(error, PortHeldError)
            self._note_failure(str(error), DeviceFlag.PORT_SHARED if held else None)
        else:
            who, wanted = (" ".join(one) for one in (found, self._identity))
            what = f"another device was found: {who}, expected: {wanted}"
            self._note_failure(what, DeviceFlag.OTHER_DEVICE)
        self._release()
        return False

    def _note_failure(self, why: str, obstacle: DeviceFlag | None) -> None:
        """Report why it cannot be opened, until the next attempt has ended."""
        more = {obstacle} if obstacle else NO_FLAGS
        self.obstacle = obstacle
        self._flags_while_lost = [each | more for each in self._lost_flags]
        self.absent = why

    def _release(self) -> None:
        """Close the device; a failure of its driver does not prevent the next opening."""
        try:
            super().close()
        except Exception as error:  # noqa: BLE001 - a failure must not end the thread
            self.absent = self.absent or str(error)


class _Silence:
    """Detects that a device answers nothing any more, call by call.

    Attributes:
        answered: Whether an exchange of this cycle succeeded; the device sets it.
    """

    def __init__(self) -> None:
        self.answered = False
        self._since_ns, self._cycles = 0, 0

    def lasts(self, flags: Sequence[Flags], now_ns: int) -> bool:
        """Return whether the silence lasts too long. Call once per cycle. Real-time safe."""
        silent = not self.answered and any(DeviceFlag.LATE_REPLY in each for each in flags)
        self.answered = False
        if not silent:
            self._cycles = 0
            return False
        if not self._cycles:
            self._since_ns = now_ns
        self._cycles += 1
        lasts = self._cycles > SILENT_CYCLES and now_ns - self._since_ns > SILENT_NS
        if lasts:
            self._cycles = 0  # for the time after the reconnection
        return lasts
