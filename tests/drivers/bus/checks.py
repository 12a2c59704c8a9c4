"""A check for each wire fault: the reaction that every driver must have."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from piezod.devices import emulators, registry
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Amplifier, Exchanges, Sensor
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import Emulated
from tests.drivers.bus.profiles import Profile

TIMEOUT_MS = 25.0
PATIENT_MS = 2000.0
AWAY = "0.05"
DRIVEN = 1.0
"""Value of every output, in its unit."""

Call = Callable[[Any], bool]
"""Uses an active device and returns whether that succeeded."""


class Session:
    """A device in another process, and drivers for it.

    Args:
        profile: The device's row.
        emulated: The process.
    """

    def __init__(self, profile: Profile, emulated: Emulated) -> None:
        self.profile, self.emulated = profile, emulated
        self.make = profile.maker(emulated.where[0], TIMEOUT_MS)

    @contextmanager
    def active(self, timeout_ms: float = TIMEOUT_MS) -> Iterator[Any]:
        """Yield an active device that works and has no flags.

        It is opened again while it gets lost: an earlier absence may still be pending.

        Args:
            timeout_ms: Time-out for replies.
        """
        make = self.profile.maker(self.emulated.where[0], timeout_ms)
        with closing(make()) as device:
            active = False

            def is_up() -> bool:
                nonlocal active
                if not active or device.lost:
                    active = starts(device)
                return active and self.works(device) and not flags_of(device)

            eventually(is_up)
            try:
                yield device
            finally:
                self.emulated.faults()

    @property
    def calls(self) -> dict[str, Call]:
        """The cyclic calls of the device, by name."""
        device, wiring = self.make(), self.profile.wiring
        n_outputs = len(wiring.outputs)
        found: dict[str, Call] = {}
        if isinstance(device, Sensor) and wiring.inputs:
            found["read"] = _reads
        if isinstance(device, Amplifier) and wiring.outputs:
            found["write"] = lambda each: each.write([DRIVEN] * n_outputs, time.monotonic_ns())
            if "A12" not in self.profile.unseen:  # else it sends no request
                found["read_back"] = _reads_back
        if isinstance(device, Exchanges) and wiring.inputs and wiring.outputs:
            found["exchange"] = lambda each: _exchanges(each, n_outputs)
        return found

    def works(self, device: Any) -> bool:
        """Return whether every cyclic call of an active device succeeds."""
        went_well = [call(device) for call in self.calls.values()]
        return all(went_well)

    def sees(self, device: Any, *flags: DeviceFlag) -> bool:
        """Use the device; return whether its status has one of these flags."""
        for call in self.calls.values():
            call(device)
        return not flags_of(device).isdisjoint(flags)

    def comes_right(self, device: Any) -> None:
        """Assert that the device works again without being opened again."""
        self.emulated.faults()
        eventually(lambda: self.works(device) and not flags_of(device))


def opens(device: Any) -> bool:
    """Open a device; return whether that succeeded."""
    try:
        device.open()
    except DeviceError:
        return False
    return True


def activates(device: Any) -> bool:
    """Activate an open device; return whether that succeeded."""
    try:
        device.activate(time.monotonic_ns())
    except DeviceError:
        return False
    return True


def starts(device: Any) -> bool:
    """Open a device, again if it is open, and activate it; return whether that succeeded."""
    device.close()
    return opens(device) and activates(device)


def flags_of(device: Any) -> frozenset[DeviceFlag]:
    """Return the flags of all channels of a device."""
    return frozenset().union(*device.status(time.monotonic_ns()))


def _reads(device: Any) -> bool:
    return all(sample.valid for sample in device.read(time.monotonic_ns()))


def _reads_back(device: Any) -> bool:
    return all(value - value == 0.0 for value in device.read_back(time.monotonic_ns()))


def _exchanges(device: Any, n_outputs: int) -> bool:
    taken, samples = device.exchange([DRIVEN] * n_outputs, time.monotonic_ns())
    return taken and all(sample.valid for sample in samples)


def pulled_in_every_call(session: Session) -> None:
    """A connection lost during a call fails this call and all later ones as a value.

    After opening it again, the device works.
    """
    for name, call in session.calls.items():
        with session.active() as device:
            session.emulated.faults(f"disconnect:1:{AWAY}")
            eventually(  # a late reply may fail a call before
                lambda call=call, device=device: (  # type: ignore[misc]
                    not call(device) and DeviceFlag.DISCONNECTED in flags_of(device)
                )
            )
            assert not call(device), name
            device.deactivate(time.monotonic_ns())


def pulled_while_opening(session: Session) -> None:
    """Opening fails with `DeviceError`, or the device is lost; later it can be opened."""
    device = session.make()
    session.emulated.faults(f"disconnect:1:{AWAY}")
    if starts(device):
        eventually(lambda: session.sees(device, DeviceFlag.DISCONNECTED))
    device.close()
    session.emulated.faults()
    with session.active():
        pass


def nobody_is_there(session: Session) -> None:
    """Opening fails again and again while the device is absent."""
    device = session.make()

    def is_refused() -> bool:
        session.emulated.faults("disconnect:now:0.1")  # again: the last absence may be over
        device.close()
        return not opens(device)

    for _ in range(2):
        eventually(is_refused)
    with session.active():
        pass


def lost_replies(session: Session) -> None:
    """A missing reply is reported as late; when replies come again, the device works again."""
    with session.active() as device:
        session.emulated.faults("lost")
        eventually(lambda: session.sees(device, DeviceFlag.LATE_REPLY))
        assert not session.works(device)
        session.comes_right(device)


def unacknowledged_writes(session: Session) -> None:
    """A write without acknowledgement counts as refused."""
    with session.active() as device:
        session.emulated.faults("lost")
        assert not session.calls["write"](device)
        session.comes_right(device)


def late_replies(session: Session) -> None:
    """Some replies come up to ten time-outs late."""
    with session.active() as device:
        session.emulated.faults(f"late:every 5:{TIMEOUT_MS * 1e-3}-{TIMEOUT_MS * 1e-2}")
        eventually(lambda: session.sees(device, DeviceFlag.LATE_REPLY))
        session.comes_right(device)


def slow_replies(session: Session) -> None:
    """Replies take most of the time-out."""
    with session.active() as device:
        session.emulated.faults(f"late:every 3:{0.86 * TIMEOUT_MS * 1e-3:.4f}")
        eventually(lambda: session.sees(device, DeviceFlag.SLOW_REPLY))
        session.comes_right(device)


def noise(session: Session) -> None:
    """Garbage precedes replies; the device works again when it stops."""
    with session.active() as device:
        session.emulated.faults("noise:every 2:1-12")
        eventually(lambda: session.sees(device, DeviceFlag.GARBAGE))
        session.comes_right(device)


def flipped_bits(session: Session) -> None:
    """The checksum detects flipped bits."""
    with session.active() as device:
        session.emulated.faults("garbled:every 2")
        eventually(lambda: session.sees(device, DeviceFlag.BAD_CHECKSUM))
        session.comes_right(device)


def garbled_replies(session: Session) -> None:
    """With any changed replies no call raises; the device works again when it stops."""
    with session.active() as device:
        for fault in ("garbled", "partial:every 2", "partial:every 2:1", "noise:every 2:1000"):
            session.emulated.faults(fault)
            session.works(device)
            flags_of(device)
            session.comes_right(device)


def duplicated_replies(session: Session) -> None:
    """Every reply comes twice; the second is no reply to the next request."""
    with session.active() as device:
        session.emulated.faults("duplicated")
        eventually(lambda: session.sees(device, DeviceFlag.OUT_OF_ORDER))
        session.comes_right(device)


def another_device(session: Session) -> None:
    """A device with another serial number that comes back is reported as long as it is there."""
    with session.active(PATIENT_MS) as device:  # a late serial number would not be read
        session.emulated.faults(f"wrong-identity:now:{AWAY}")
        eventually(lambda: session.sees(device, DeviceFlag.DISCONNECTED))
        device.close()
        eventually(lambda: opens(device))
        assert DeviceFlag.OTHER_DEVICE in flags_of(device)
        assert DeviceFlag.OTHER_DEVICE in flags_of(device)


def another_path(session: Session) -> None:
    """A port that comes back as another device path, under the same name, is reported once."""
    with session.active() as device:
        port = Path(session.emulated.where[0])
        before = port.resolve()
        session.emulated.faults(f"disconnect:now:{AWAY}")
        eventually(lambda: session.sees(device, DeviceFlag.DISCONNECTED))
        eventually(lambda: port.exists() and port.resolve() != before)
        device.close()
        eventually(lambda: opens(device))
        assert DeviceFlag.OTHER_PATH in flags_of(device)
        assert DeviceFlag.OTHER_PATH not in flags_of(device)


def shared_port(session: Session) -> None:
    """A second program is refused while the first one has the port."""
    with session.active() as device:
        second = session.make()
        with pytest.raises(DeviceError, match="held by another program"):
            second.open()
        eventually(lambda: session.works(device))


def _fails_to_send(session: Session, flag: DeviceFlag) -> None:
    def fail(*_: object) -> None:
        raise LineFault(flag, "the test demands it")

    with session.active() as device, pytest.MonkeyPatch.context() as patched:
        for line in ("serial_line.SerialLine", "tcp_line.TcpLine"):
            patched.setattr(f"piezod.devices.bus.{line}.send", fail)
        for call in session.calls.values():
            call(device)
        assert flag in flags_of(device)


def partial_writes(session: Session) -> None:
    """A request that is not sent completely fails and is reported."""
    _fails_to_send(session, DeviceFlag.PARTIAL_WRITE)


def half_open_connection(session: Session) -> None:
    """A connection without any acknowledgement is reported and lost."""
    _fails_to_send(session, DeviceFlag.HALF_OPEN)


def reads_back_what_it_wrote(session: Session) -> None:
    """The value in force is measured by the device, near the written one."""
    with session.active() as device:
        n = len(session.profile.wiring.outputs)
        before = device.read_back(time.monotonic_ns())
        assert device.capabilities().read_back
        for value in (DRIVEN + 2.0, DRIVEN):
            eventually(lambda value=value: device.write([value] * n, time.monotonic_ns()))  # type: ignore[misc]
            eventually(lambda value=value: _near(device, value))  # type: ignore[misc]
        assert len(before) == n


def _near(device: Any, value: float) -> bool:
    return all(abs(found - value) < 0.5 for found in device.read_back(time.monotonic_ns()))


class Row(NamedTuple):
    """A check."""

    check: Callable[[Session], None]  #: The check.
    #: Faults that a driver detects if it passes; it applies to drivers that detect all of them.
    ids: tuple[str, ...] = ()


CHECKS = (
    Row(pulled_in_every_call, ("B1",)),
    Row(pulled_while_opening),
    Row(nobody_is_there),
    Row(lost_replies, ("B5",)),
    Row(unacknowledged_writes, ("A1",)),
    Row(late_replies, ("B5",)),
    Row(slow_replies, ("B7",)),
    Row(noise, ("B3",)),
    Row(flipped_bits, ("B4",)),
    Row(garbled_replies),
    Row(duplicated_replies, ("B6",)),
    Row(another_path, ("B2",)),
    Row(shared_port, ("B14",)),
    Row(partial_writes, ("A2",)),
    Row(half_open_connection, ("B13",)),
    Row(reads_back_what_it_wrote, ("A3", "A12")),
    Row(another_device, ("S10",)),  # last, because the other device then stays
)


def checks_of(profile: Profile) -> list[Row]:
    """Return the checks for a device: those of the faults that its driver claims to detect."""
    sees = registry.load(profile.driver).sees - profile.unseen
    if not profile.wiring.outputs:
        sees -= {"A1", "A3", "A12"}
    serial = emulators.load(profile.name).wire == "serial"
    sees -= {"B13"} if serial else {"B2", "B14"}
    return [row for row in CHECKS if sees.issuperset(row.ids)]
