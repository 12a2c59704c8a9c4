"""A bus by python-can: its queue, its errors and its echoes."""

import errno
import select
import socket
from collections import deque
from collections.abc import Iterator
from itertools import count
from types import SimpleNamespace
from typing import Any

import can
import pytest

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.interface_control import KernelInterfaces
from piezod_drivers.can_bus.library_bus import LibraryBus
from tests.drivers.can_bus.ports import free_port

A, B = Frame(0x305, b"\x01\x02"), Frame(0x80)
FULL = (
    can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
    can.CanOperationError("Transmit buffer full"),
    OSError(errno.ENOBUFS, "No buffer space available"),
)
MS = 1_000_000


class _Controller:
    """A stand-in for python-can's bus and for the kernel's queue, which outlives that bus.

    Attributes:
        queue: Frames that have not been sent yet.
        on_bus: Frames that have been sent.
        waits_s: Each time that a frame was waited for, in s.
    """

    def __init__(self) -> None:
        self.queue: deque[can.Message] = deque()
        self.on_bus: list[can.Message] = []
        self.coming: deque[Any] = deque()
        self.stuck = False
        self.failure: Exception | None = None
        self.settings: dict[str, Any] = {}
        self.waits_s: list[float] = []

    def make(self, **settings: Any) -> "_Controller":
        self.settings = settings
        self.let_go()
        return self

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        assert timeout == 0, "sending must not wait"
        if self.failure is not None:
            raise self.failure
        self.queue.append(can.Message(arbitration_id=message.arbitration_id, data=message.data))
        self.let_go()

    def recv(self, timeout: float) -> can.Message | None:
        self.waits_s.append(timeout)
        found = self.coming.popleft() if self.coming else None
        if isinstance(found, Exception):
            raise found
        return found

    def let_go(self) -> None:
        while self.queue and not self.stuck:
            self.on_bus.append(self.queue.popleft())

    def flush_tx_buffer(self) -> None:
        raise NotImplementedError

    def shutdown(self) -> None:
        pass


class _Network:
    """Implements `InterfaceControl`: down and up empties the queue, if that is permitted."""

    def __init__(self, controller: _Controller) -> None:
        self._controller = controller
        self.downs = 0
        self.allowed = True

    def down_count(self, name: str) -> int:
        assert name == "can0"
        return self.downs

    def restart(self, name: str) -> None:
        assert name == "can0"
        if not self.allowed:
            raise DeviceUnavailableError("as root, ip link set can0 down")
        self.downs += 1
        self._controller.queue.clear()


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch) -> _Controller:
    """Return a controller that replaces python-can's."""
    controller = _Controller()
    monkeypatch.setattr(can, "Bus", controller.make)
    return controller


@pytest.fixture
def network(controller: _Controller) -> _Network:
    """Return the interface control of the controller."""
    return _Network(controller)


@pytest.fixture
def bus(network: _Network) -> Iterator[LibraryBus]:
    """Return an open socketcan bus."""
    bus = LibraryBus("socketcan", "can0", {}, network)
    bus.open((0x285, 0x1ABCDEF0))
    yield bus
    bus.close()


def _flag(call: Any) -> DeviceFlag:
    with pytest.raises(LineFault) as failure:
        call()
    return failure.value.flag


def test_kernel_filters_what_is_not_accepted(bus: LibraryBus, controller: _Controller) -> None:
    """Socketcan gets the accepted identifiers, and python-can reads no configuration file."""
    assert controller.settings["can_filters"] == [
        {"can_id": 0x285, "can_mask": 0x7FF},
        {"can_id": 0x1ABCDEF0, "can_mask": 0x1FFFFFFF},
    ]
    assert controller.settings["ignore_config"] is True
    assert bus.where == "socketcan can0"


@pytest.mark.sees("canopen", "B9")
@pytest.mark.sees("can_dbc", "B9")
@pytest.mark.parametrize("failure", FULL, ids=["ENOBUFS", "text", "OSError"])
def test_full_queue_is_reported(
    bus: LibraryBus, controller: _Controller, failure: Exception
) -> None:
    """A full queue is recognized by python-can's error number or error text."""
    controller.failure = failure

    assert _flag(lambda: bus.send(A)) == DeviceFlag.NOT_SENT


@pytest.mark.parametrize("number", [errno.ENETDOWN, errno.ENODEV])
def test_lost_interface_is_reported(bus: LibraryBus, controller: _Controller, number: int) -> None:
    """Any other error means that the interface is lost."""
    controller.failure = can.CanOperationError("Failed to transmit", number)
    controller.coming.append(can.CanOperationError("Failed to receive", number))

    assert _flag(lambda: bus.send(A)) == DeviceFlag.DISCONNECTED
    assert _flag(lambda: bus.receive(0)) == DeviceFlag.DISCONNECTED


def test_closed_bus_is_reported() -> None:
    """A bus that is not open reports that it is disconnected."""
    bus = LibraryBus("virtual", "x", {})

    assert _flag(lambda: bus.send(A)) == DeviceFlag.DISCONNECTED
    assert _flag(lambda: bus.receive(0)) == DeviceFlag.DISCONNECTED
    bus.close()


def _error(classes: int, data: bytes = bytes(8)) -> can.Message:
    return can.Message(arbitration_id=classes, data=data, is_error_frame=True)


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_controller_off_the_bus_is_reported(bus: LibraryBus, controller: _Controller) -> None:
    """An error frame for bus off loses the bus."""
    controller.coming.append(_error(0x40))

    assert _flag(lambda: bus.receive(MS)) == DeviceFlag.BUS_OFF


def test_passive_controller_is_reported(bus: LibraryBus, controller: _Controller) -> None:
    """An error frame for missing acknowledgements is reported and hides no frame."""
    answer = can.Message(arbitration_id=0x285, data=b"1", is_extended_id=False)
    controller.coming += [_error(0x04, bytes((0, 0x20, 0, 0, 0, 0, 0, 0))), _error(0x200), answer]

    assert bus.receive(MS) == Frame(0x285, b"1")
    assert bus.take_noticed() == {DeviceFlag.NOT_SENT}


@pytest.mark.parametrize("within_ns", [0, MS])
def test_flood_of_error_frames_ends_a_call(
    bus: LibraryBus, controller: _Controller, within_ns: int
) -> None:
    """Without an acknowledgement they may come faster than they are read: the loop goes on."""
    controller.coming += [_error(0x200)] * 1000

    assert bus.receive(within_ns) is None
    assert len(controller.coming) >= 900


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
def test_old_setpoint_never_leaves(bus: LibraryBus, controller: _Controller) -> None:
    """After a stall, opening takes the interface down and up, which empties its queue."""
    controller.stuck = True
    bus.send(A)
    bus.mark_stalled()
    bus.close()
    controller.stuck = False
    bus.open(())
    bus.send(B)

    assert [message.arbitration_id for message in controller.on_bus] == [B.id]


def test_bus_off_empties_the_queue_too(bus: LibraryBus, controller: _Controller) -> None:
    """Opening after bus off empties the queue as well."""
    controller.stuck = True
    bus.send(A)
    controller.coming.append(_error(0x40))
    _flag(lambda: bus.receive(0))
    controller.stuck = False
    bus.open(())

    assert controller.on_bus == []


def test_queue_that_cannot_be_emptied_is_not_used(
    bus: LibraryBus, controller: _Controller, network: _Network
) -> None:
    """Without the right to restart the interface, opening is refused until it was restarted."""
    controller.stuck = True
    bus.send(A)
    bus.mark_stalled()
    network.allowed = False
    with pytest.raises(DeviceUnavailableError, match="ip link set can0 down"):
        bus.open(())

    network.downs += 1  # the interface has been taken down
    controller.queue.clear()
    controller.stuck = False
    bus.open(())
    assert controller.on_bus == []


def test_library_that_raises_anything_fails_as_ours() -> None:
    """Any error of python-can at opening becomes an error that names the bus."""
    with pytest.raises(DeviceUnavailableError, match="no_such_interface x cannot be opened"):
        LibraryBus("no_such_interface", "x", {}).open(())


def test_two_ends_of_a_virtual_bus() -> None:
    """Standard and extended frames pass between the ends of a virtual bus."""
    one, other = (LibraryBus("virtual", "a test's", {}) for _ in range(2))
    one.open(())
    other.open(())
    frames = [A, Frame(0x1ABCDEF0, bytes(8), extended=True), Frame(0x123, bytes(2), remote=True)]
    for frame in frames:
        one.send(frame)

    got = [other.receive(1000 * MS) for _ in frames]
    assert [(frame.id, frame.extended, frame.remote) for frame in got if frame] == [
        (frame.id, frame.extended, frame.remote) for frame in frames
    ]
    assert got[0] == A
    assert one.receive(0) is None
    one.close()
    other.close()


@pytest.fixture
def group() -> Iterator[tuple[LibraryBus, LibraryBus]]:
    """Return two members of a UDP group."""
    settings = {"port": free_port(), "hop_limit": 0, "fd": False}
    one, other = (LibraryBus("udp_multicast", "239.74.163.45", settings) for _ in range(2))
    one.open(())
    other.open(())
    yield one, other
    one.close()
    other.close()


@pytest.mark.sees("canopen", "B12")
@pytest.mark.sees("can_dbc", "B12")
def test_own_frames_are_distinguished_from_others(group: tuple[LibraryBus, LibraryBus]) -> None:
    """In a UDP group own frames are dropped; the same frame from another member is not."""
    one, other = group
    one.send(A)
    one.send(B)
    assert [other.receive(1000 * MS), other.receive(1000 * MS)] == [A, B]
    other.send(A)

    assert one.receive(1000 * MS) == A
    assert one.receive(0) is None


def test_packet_that_is_no_frame_is_reported(group: tuple[LibraryBus, LibraryBus]) -> None:
    """A stray packet at the group's port is garbage and hides no frame."""
    one, other = group
    port = one._settings["port"]  # noqa: SLF001 - the port that the fixture drew
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stray:
        stray.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        stray.sendto(b"hello", ("239.74.163.45", port))
    other.send(A)

    assert one.receive(1000 * MS) == A
    assert one.take_noticed() == {DeviceFlag.GARBAGE}


def test_stray_packets_do_not_prolong_the_wait(
    bus: LibraryBus, controller: _Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stray packets do not prolong the wait for a frame."""
    instants = count(0, MS)
    clock = SimpleNamespace(monotonic_ns=lambda: next(instants))
    monkeypatch.setattr("piezod_drivers.can_bus.library_bus.time", clock)
    controller.coming += [can.CanOperationError("could not unpack received message")] * 4

    assert bus.receive(5 * MS) is None
    assert controller.waits_s == pytest.approx([0.004, 0.003, 0.002, 0.001, 0.0])


def test_absent_interface_is_reported_with_its_remedy() -> None:
    """For a missing interface, or a kernel without CAN, the error names the remedy."""
    with pytest.raises(DeviceUnavailableError, match=r"no CAN|ip link set can0 up"):
        LibraryBus("socketcan", "can0", {}).open(())


def test_kernel_is_asked_for_what_it_knows() -> None:
    """A missing interface has a down count of 0 and cannot be restarted."""
    assert KernelInterfaces().down_count("no-such-if") == 0
    with pytest.raises(DeviceUnavailableError, match="no-such-if may still hold old frames"):
        KernelInterfaces().restart("no-such-if")


def test_taking_an_interface_down_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each time that an interface is taken down counts once, by the error of a bound socket."""

    def refused(_name: str) -> socket.socket:
        """Return a socket with a pending error."""
        pending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        pending.connect(("127.0.0.1", free_port()))
        pending.send(b"")
        look = select.poll()
        look.register(pending, 0)
        assert look.poll(20_000), "the error has come"
        return pending

    monkeypatch.setattr("piezod_drivers.can_bus.interface_control._monitor", refused)
    kernel = KernelInterfaces()
    assert [kernel.down_count("no-such-can") for _ in range(4)] == [0, 1, 1, 2]


def test_socketcan_interface_carries_frames() -> None:
    """Two ends of a virtual kernel interface exchange frames, if the kernel has CAN."""
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as probe:
            probe.bind(("vcan0",))
    except OSError as error:
        pytest.skip(f"no vcan0: {error}")
    one, other = (LibraryBus("socketcan", "vcan0", {}) for _ in range(2))
    one.open((A.id,))
    other.open((A.id,))
    one.send(B)
    one.send(A)
    assert other.receive(1000 * MS) == A
    one.close()
    other.close()
