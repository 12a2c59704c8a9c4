"""A driver and its emulated device in one process, in virtual time."""

import random
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import pytest

from piezod.devices import emulators, registry
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.faults import ActiveFault, WireFaultKind, WireFaults
from piezod.devices.emulation.outbox import Outbox
from piezod.devices.status import DeviceFlag
from tests.drivers.bus.profiles import Profile
from tests.drivers.serial_line.linear_rig import LinearRig

MS = 1_000_000
ON_THE_WAY_NS = 100_000
TICK_NS = MS


class StillRig(LinearRig):
    """A rig whose axes stay where the test puts them, at `at_um`.

    Args:
        n_axes: Number of axes.
    """

    def __init__(self, n_axes: int) -> None:
        super().__init__(n_axes, um_per_v=0.0)


class Wire:
    """The wire between a driver and an emulated device; replies may be late and requests lost.

    Args:
        profile: The device.
        timeout_ms: Time-out of the driver.
        seed: Seed of the random faults.

    Attributes:
        emulator: The device.
        rig: The rig of the device.
        late: Fraction of the replies that are late, by 1 to 10 time-outs.
        lost: Fraction of the requests that are lost.
        change: Changes each reply on its way.
        sent: Number of requests that were sent.
        requests: The last of them.
        now_ns: The time.
    """

    def __init__(self, profile: Profile, timeout_ms: float, seed: int) -> None:
        self.sent, self.now_ns = 0, 1_000_000_000
        plugin = emulators.load(profile.name)
        assert plugin.create is not None, f"{profile.name} is on no wire"
        arguments = dict(zip(profile.arguments[::2], profile.arguments[1::2], strict=True))
        self.rig = StillRig(int(arguments.get("--axes", plugin.channels)))
        self.emulator = plugin.create(SharedRig(self.rig, lambda: self.now_ns), "")
        self._outbox = Outbox(WireFaults())
        self._random = random.Random(seed)  # noqa: S311 - repeatable
        self._timeout_ms, self._tick_ns = timeout_ms, 0
        self.late = self.lost = 0.0
        self.change: Callable[[bytes], bytes] = lambda reply: reply
        self.requests: deque[bytes] = deque(maxlen=200)

    def send(self, data: bytes) -> None:
        """Pass a request to the device, or lose it."""
        self.sent += 1
        self.requests.append(data)
        if self._random.random() >= self.lost:
            self._put(self.emulator.receive(data))

    def receive(self, within_ns: int) -> bytes:
        """Let time pass until bytes come to the driver."""
        end_ns = self.now_ns + within_ns
        while True:
            if self.now_ns >= self._tick_ns:
                self._tick_ns = self.now_ns + TICK_NS
                self._put(self.emulator.due())
            if data := self._outbox.take(self.now_ns):
                return data
            if self.now_ns >= end_ns:
                return b""
            wait_ns = self._outbox.wait_ns(self.now_ns, end_ns - self.now_ns)
            self.now_ns += min(wait_ns, max(self._tick_ns - self.now_ns, 1))

    def wait(self, for_ns: int) -> None:
        """Let time pass without requests."""
        end_ns = self.now_ns + for_ns
        while self.now_ns < end_ns:
            self.now_ns = min(end_ns, max(self._tick_ns, self.now_ns + 1))
            if self.now_ns >= self._tick_ns:
                self._tick_ns = self.now_ns + TICK_NS
                self._put(self.emulator.due())

    def _put(self, replies: Sequence[bytes]) -> None:
        for reply in replies:
            late = self._random.random() < self.late
            late_s = self._random.uniform(1, 10) * self._timeout_ms * 1e-3 if late else 0.0
            hits = [ActiveFault(WireFaultKind.LATE, late_s)]
            self._outbox.put(self.change(reply), hits, self.now_ns + ON_THE_WAY_NS)


@contextmanager
def wired(profile: Profile, timeout_ms: float = 20.0, seed: int = 1) -> Iterator[Wire]:
    """Let every line lead to a device in this process while the block runs."""
    wire = Wire(profile, timeout_ms, seed)
    registry.load(profile.driver)  # its line classes are imported from now on
    with pytest.MonkeyPatch.context() as patched:
        for line in (SerialLine, *SerialLine.__subclasses__(), TcpLine):
            patched.setattr(line, "open", lambda _: None)
            patched.setattr(line, "close", lambda _: None)
            patched.setattr(line, "send", lambda _, data: wire.send(data))
            patched.setattr(line, "receive", lambda _, within_ns: wire.receive(within_ns))
            patched.setattr(line, "now_ns", lambda _: wire.now_ns)
        no_flags: set[DeviceFlag] = set()
        patched.setattr(SerialLine, "take_noticed", lambda _: no_flags)
        yield wire
