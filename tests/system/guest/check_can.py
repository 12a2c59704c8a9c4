"""CAN at a real kernel; `tests/system/test_guest_buses.py` runs this file in the guest."""

import gc
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import canopen
import pytest

from piezod.devices import registry
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.conversation import STALLED_AFTER, CanConversation
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.library_bus import LibraryBus
from tests.daemon.waiting import eventually
from tests.drivers.can_bus.canopen_node import Device
from tests.drivers.can_bus.profiles import CODES
from tests.drivers.can_bus.profiles import canopen as canopen_options

pytestmark = pytest.mark.skipif("PIEZOD_GUEST" not in os.environ, reason="runs in the guest")

CODES_PER_V = 3276.7
SECOND_NS = 1_000_000_000
SETPOINTS, SYNC, HOST_BEAT = 0x305, 0x80, 0x700 + 126
OLD, NEW = Frame(SETPOINTS, b"\x01\x02"), Frame(SETPOINTS, b"\x03\x04")
NOBODY = 65_534


def system(command: str) -> str:
    """Run a command; return its output."""
    ended = subprocess.run(command.split(), capture_output=True, text=True, check=False)
    assert ended.returncode == 0, f"{command}: {ended.stderr}"
    return ended.stdout


def up(name: str) -> None:
    """Bring the interface of a controller up."""
    system(f"ip link set {name} up type can bitrate 500000")


@pytest.fixture
def vcan() -> Iterator[str]:
    """Return a virtual interface of the kernel, up."""
    system("ip link add vcan0 type vcan")
    system("ip link set vcan0 up")
    yield "vcan0"
    subprocess.run(["ip", "link", "delete", "vcan0"], check=True)  # noqa: S607 - the guest's own


@pytest.fixture
def controllers() -> Iterator[tuple[str, str]]:
    """Return two controllers on one bus, up."""
    for name in ("can0", "can1"):
        up(name)
    yield "can0", "can1"
    for name in ("can0", "can1"):
        system(f"ip link set {name} down")


@contextmanager
def node_on(name: str) -> Iterator[None]:
    """Run a node of the canopen library on an interface."""
    network = canopen.Network()
    network.connect(interface="socketcan", channel=name)
    try:
        Device(network)
        yield
    finally:
        network.disconnect()


@contextmanager
def listening(name: str) -> Iterator[can.BusABC]:
    """Receive every frame on an interface."""
    with can.Bus(interface="socketcan", channel=name) as bus:
        yield bus


def next_data(bus: can.BusABC) -> bytes:
    """Return the data of the next frame."""
    message = eventually(lambda: bus.recv(0))
    assert message is not None
    return bytes(message.data)


def heard(bus: can.BusABC) -> list[can.Message]:
    """Return the frames that have come."""
    return list(iter(lambda: bus.recv(0), None))


def device_on(name: str, **more: Any) -> Any:
    """Return the device of our driver for the node on an interface, not open."""
    bus = {"interface": "socketcan", "channel": name}
    plugin = registry.load("canopen")
    settings = {**canopen_options("", **more), "bus": bus}
    return plugin.create(
        plugin.options_model.model_validate(settings), Wiring(("ai1",), ("ao1",)), 1
    )


def device_at(name: str, **more: Any) -> Any:
    """Return the device of our driver, open and active."""
    device = device_on(name, **more)
    device.open()
    device.activate(time.monotonic_ns())
    return device


def drives(device: Any, volts: float) -> None:
    """Assert that the output is set and read back, and that the input shows half of it."""
    now_ns = time.monotonic_ns()
    taken, (sample,) = device.exchange([volts], now_ns)
    assert taken, device.status(now_ns)
    assert sample.position_um == pytest.approx(volts / 2, abs=2 / CODES_PER_V)
    assert device.read_back(now_ns) == pytest.approx([volts], abs=1 / CODES_PER_V)


def flags(device: Any) -> set[DeviceFlag]:
    """Return the flags of all channels of a device."""
    return set().union(*device.status(time.monotonic_ns()))


@contextmanager
def plugged(name: str, n_frames: int) -> Iterator[None]:
    """Hold frames back in the queue of the kernel, as on a bus without acknowledgement."""
    system(f"tc qdisc add dev {name} root plug limit {n_frames * 16}")
    try:
        yield
    finally:
        system(f"tc qdisc delete dev {name} root")


def unplug(name: str) -> None:
    """Release the queue."""
    system(f"tc qdisc change dev {name} root plug release_indefinite")


def test_driver_drives_a_node_at_a_virtual_interface(vcan: str) -> None:
    """The driver opens, sets up, writes, reads and reads back, by frames of the kernel."""
    with node_on(vcan):
        device = device_at(vcan)
        for volts in (1.0, -3.0, 8.0):
            drives(device, volts)
        assert flags(device) == set()
        device.close()


def test_driver_drives_a_node_at_another_controller(controllers: tuple[str, str]) -> None:
    """The same works with an SJA1000 at each end."""
    ours, theirs = controllers
    with node_on(theirs):
        device = device_at(ours)
        for volts in (1.0, -3.0, 8.0):
            drives(device, volts)
        assert flags(device) == set()
        device.close()


def test_kernel_filters_foreign_and_own_frames(vcan: str) -> None:
    """Frames that are not accepted, and our own frames, do not arrive; all others do."""
    bus = LibraryBus("socketcan", vcan, {})
    bus.open((0x123, 0x12345))
    with listening(vcan) as other:
        bus.send(Frame(0x123, b"own"))
        sent = next_data(other)
        for number, extended in ((0x124, False), (0x12345, True), (0x123, False)):
            other.send(can.Message(arbitration_id=number, data=b"x", is_extended_id=extended))
        assert bus.receive(SECOND_NS) == Frame(0x12345, b"x", extended=True)
        assert bus.receive(SECOND_NS) == Frame(0x123, b"x")
        assert bus.receive(0) is None
    bus.close()
    assert sent == b"own"


def test_host_sends_a_heartbeat(vcan: str) -> None:
    """If the node watches this host, its heartbeat is on the bus, and stops at the end."""
    outputs = {"ao1": {"number": 1, **CODES, "safe_code": 0}}
    with node_on(vcan), listening(vcan) as ear:
        device = device_at(vcan, outputs=outputs, watchdog_ms=10_000)
        assert device.capabilities().watchdog
        assert HOST_BEAT not in [message.arbitration_id for message in heard(ear)]
        drives(device, 1.0)
        beats = [message for message in heard(ear) if message.arbitration_id == HOST_BEAT]
        device.close()
    assert [bytes(beat.data) for beat in beats] == [b"\x05"]


@pytest.mark.sees("canopen", "B12")
def test_foreign_setpoint_is_detected(vcan: str) -> None:
    """A setpoint that another program sends is detected."""
    with node_on(vcan), listening(vcan) as other:
        device = device_at(vcan)
        drives(device, 1.0)
        other.send(can.Message(arbitration_id=SETPOINTS, data=bytes(2), is_extended_id=False))
        device.exchange([1.0], time.monotonic_ns())
        assert flags(device) == {DeviceFlag.FOREIGN_FRAME}
        device.close()


def is_lost(device: Any) -> bool:
    """Return whether a device reports that it is lost."""
    _, (sample,) = device.exchange([1.0], time.monotonic_ns())
    return not sample.valid and flags(device) == {DeviceFlag.DISCONNECTED}


@pytest.mark.sees("canopen", "B1")
def test_interface_that_is_taken_down_is_detected(controllers: tuple[str, str]) -> None:
    """The device is lost, cannot be opened, and works again when the interface is up."""
    ours, theirs = controllers
    with node_on(theirs):
        device = device_at(ours)
        drives(device, 1.0)
        system(f"ip link set {ours} down")
        assert is_lost(device)
        device.close()
        with pytest.raises(DeviceUnavailableError, match="down") as refusal:
            device.open()
        print(refusal.value)
        up(ours)
        device.open()
        device.activate(time.monotonic_ns())
        drives(device, 2.0)
        device.close()


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")  # of python-can, when it raises
@pytest.mark.sees("canopen", "B1")
def test_removed_controller_is_detected(controllers: tuple[str, str]) -> None:
    """The same holds if the controller itself is removed and comes back."""
    ours, theirs = controllers
    function = Path(f"/sys/class/net/{ours}/device").resolve()
    with node_on(theirs):
        device = device_at(ours)
        drives(device, 1.0)
        (function / "remove").write_text("1")
        assert is_lost(device)
        device.close()
        with pytest.raises(DeviceUnavailableError, match="bring it up: ip link set"):
            device.open()
        gc.collect()
        Path("/sys/bus/pci/rescan").write_text("1")
        eventually(lambda: Path(f"/sys/class/net/{ours}").exists())
        up(ours)
        device.open()
        device.activate(time.monotonic_ns())
        drives(device, 2.0)
        device.close()


@pytest.mark.sees("canopen", "B9")
def test_full_queue_is_detected(controllers: tuple[str, str]) -> None:
    """The kernel's ENOBUFS becomes the flag `NOT_SENT`."""
    ours, _ = controllers
    bus = LibraryBus("socketcan", ours, {})
    bus.open(())
    with plugged(ours, 2):
        bus.send(OLD)
        bus.send(OLD)
        with pytest.raises(LineFault) as caught:
            bus.send(OLD)
        assert caught.value.flag is DeviceFlag.NOT_SENT
        bus.close()


def test_kernel_keeps_frames_of_a_closed_socket(controllers: tuple[str, str]) -> None:
    """A frame in the queue outlives its socket and is sent later, which is the danger."""
    ours, theirs = controllers
    with plugged(ours, 2):
        with listening(ours) as sender:
            sender.send(can.Message(arbitration_id=OLD.id, data=OLD.data, is_extended_id=False))
        with listening(theirs) as ear:
            unplug(ours)
            assert next_data(ear) == OLD.data


@pytest.mark.sees("canopen", "B8")
def test_old_setpoint_never_leaves(controllers: tuple[str, str]) -> None:
    """A bus that is opened again after a stall sends the new setpoint and no old one."""
    ours, theirs = controllers
    bus = LibraryBus("socketcan", ours, {})
    bus.open(())
    with plugged(ours, 2):
        stall(CanConversation(bus, SECOND_NS, (), lambda _: None))
        bus.close()
        with listening(theirs) as ear:
            bus.open(())
            unplug(ours)
            bus.send(NEW)
            assert next_data(ear) == NEW.data
            assert heard(ear) == []
        bus.close()


@pytest.mark.sees("canopen", "B8")
def test_stalled_device_drives_again(controllers: tuple[str, str]) -> None:
    """A stalled device is lost; opened again, it sends no old setpoint, and drives."""
    ours, theirs = controllers
    with node_on(theirs), listening(theirs) as ear:
        device = device_at(ours)
        drives(device, 1.0)
        heard(ear)
        with plugged(ours, 1):
            taken = [device.exchange([9.0], time.monotonic_ns())[0] for _ in range(9)]
            assert not any(taken)
            assert DeviceFlag.BUS_OFF in flags(device)
            device.close()
        device.open()
        device.activate(time.monotonic_ns())
        drives(device, 2.0)
        device.close()
        sent = [bytes(each.data) for each in heard(ear) if each.arbitration_id == SETPOINTS]
    assert set(sent) == {round(2.0 * CODES_PER_V).to_bytes(2, "little")}


def test_queue_is_not_used_without_the_right_to_empty_it(controllers: tuple[str, str]) -> None:
    """A user without this right is told what to do; any user may do it."""
    ours, _ = controllers
    bus = LibraryBus("socketcan", ours, {})
    bus.open(())
    with plugged(ours, 2):
        stall(CanConversation(bus, SECOND_NS, (), lambda _: None))
        bus.close()
        os.seteuid(NOBODY)  # gives up the rights of root
        try:
            with pytest.raises(DeviceUnavailableError, match=f"ip link set {ours} down"):
                bus.open(())
        finally:
            os.seteuid(0)
        system(f"ip link set {ours} down")
        up(ours)
        os.seteuid(NOBODY)
        try:
            bus.open(())
        finally:
            os.seteuid(0)
        bus.close()


@pytest.mark.sees("canopen", "B8")
def test_controller_off_the_bus_is_detected(vcan: str) -> None:
    """After the kernel's error frame the device is lost; reopening it takes the interface down."""
    with listening(vcan) as driver:
        with node_on(vcan):
            device = device_at(vcan)
            drives(device, 1.0)
        driver.send(can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True))
        taken, _ = device.exchange([2.0], time.monotonic_ns())
        assert not taken
        assert flags(device) == {DeviceFlag.BUS_OFF}
        device.close()
        heard(driver)
        with pytest.raises(DeviceUnavailableError, match="does not answer"):
            device.open()
        with pytest.raises(can.CanOperationError, match="down"):
            heard(driver)


def stall(cycle: CanConversation) -> None:
    """Send until the bus counts as off."""
    for _ in range(2):
        cycle.tell(OLD)
    caught = []
    for _ in range(STALLED_AFTER):
        with pytest.raises(LineFault) as fault:
            cycle.tell(OLD)
        caught.append(fault.value.flag)
    assert caught == [DeviceFlag.NOT_SENT] * (STALLED_AFTER - 1) + [DeviceFlag.BUS_OFF]
