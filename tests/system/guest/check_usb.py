"""A USB serial adapter at a real kernel; `test_guest_buses.py` runs this file in the guest."""

import errno
import os
import struct
import termios
import threading
import time
from collections.abc import Iterator
from fcntl import ioctl
from pathlib import Path
from typing import Any, Final

import pytest

from piezod.devices import registry
from piezod.devices.bus.line import LineFault
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.skipif("PIEZOD_GUEST" not in os.environ, reason="runs in the guest")

BY_ID: Final = Path("/dev/serial/by-id")
OURS: Final = "OURS"
"""Serial number of the adapter with an amplifier behind it."""
SECOND_NS: Final = 1_000_000_000
NOBODY: Final = 65_534
_LOW_LATENCY: Final = 0x2000
_SERIAL_STRUCT: Final = struct.Struct("iiIii")
"""The beginning of the kernel's serial_struct: type, line, port, irq, flags."""


def host(request: str) -> None:
    """Send a request to the machine that hosts the guest."""
    fd = os.open("/dev/ttyS1", os.O_RDWR | os.O_NOCTTY)
    os.write(fd, f"{request}\n".encode())
    answer = b""
    while not answer.endswith(b"\n"):
        answer += os.read(fd, 1)
    os.close(fd)
    assert answer == b"ok\n", answer


def path_of(identity: str) -> Path:
    """Return the path that udev gives to the adapter with this serial number."""
    return BY_ID / f"usb-QEMU_QEMU_USB_SERIAL_{identity}-if00-port0"


def plug(identity: str, what: str = "wire") -> str:
    """Plug an adapter in; return its path when it exists."""
    host(f"plug {identity} {what}")
    eventually(path_of(identity).exists)
    return str(path_of(identity))


def unplug(identity: str) -> None:
    """Unplug an adapter, and wait until its path is gone."""
    host(f"unplug {identity}")
    eventually(lambda: not path_of(identity).exists())


@pytest.fixture
def adapter() -> Iterator[str]:
    """Return the path of an adapter, which is unplugged at the end."""
    yield plug(OURS)
    if path_of(OURS).exists():
        unplug(OURS)


def amplifier(path: str) -> Any:
    """Return the amplifier behind the adapter, not open."""
    plugin = registry.load("thorlabs_mdt")
    options = plugin.options_model.model_validate({"port": path, "timeout_ms": 2000})
    return plugin.create(options, Wiring((), ("x",)), 1)


def drives(device: Any, volts: float) -> None:
    """Open the amplifier, and assert that it sets its output."""
    device.open()
    device.activate(time.monotonic_ns())
    assert device.write([volts], time.monotonic_ns())
    assert device.read_back(time.monotonic_ns()) == pytest.approx([volts], abs=0.5)


def flags(device: Any) -> set[DeviceFlag]:
    """Return the flags of all channels of a device."""
    return set().union(*device.status(time.monotonic_ns()))


def test_bytes_are_passed_on_at_once(adapter: str) -> None:
    """The adapter is in low-latency mode: its own timer is at 1 ms."""
    timer = Path("/sys/class/tty") / Path(adapter).resolve().name / "device" / "latency_timer"
    before = timer.read_text()
    line = SerialLine(adapter, 115_200)
    line.open()
    fd = os.open(adapter, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    settings = ioctl(fd, termios.TIOCGSERIAL, bytes(256))
    os.close(fd)
    assert _SERIAL_STRUCT.unpack_from(settings)[4] & _LOW_LATENCY
    print("latency timer, ms:", before.strip(), timer.read_text().strip())
    assert timer.read_text().strip() == "1"
    line.close()


@pytest.mark.sees("thorlabs_mdt", "B14")
def test_port_is_held_alone(adapter: str) -> None:
    """Our lock refuses a second line, and the kernel refuses programs that ask for no lock."""
    Path(adapter).chmod(0o666)
    line, other = SerialLine(adapter, 115_200), SerialLine(adapter, 115_200)
    line.open()
    with pytest.raises(DeviceUnavailableError, match="held by another program"):
        other.open()
    os.seteuid(NOBODY)  # the kernel never refuses root
    try:
        with pytest.raises(OSError, match="busy") as refusal:
            os.close(os.open(adapter, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
        with pytest.raises(DeviceUnavailableError, match="held by another program"):
            other.open()
    finally:
        os.seteuid(0)
    assert refusal.value.errno == errno.EBUSY
    line.close()
    other.open()
    other.close()


@pytest.mark.sees("thorlabs_mdt", "B1")
def test_unplugged_adapter_is_detected(adapter: str) -> None:
    """The device is lost, cannot be opened, and drives again when the adapter is plugged in."""
    device = amplifier(adapter)
    drives(device, 20.0)
    unplug(OURS)
    assert not device.write([30.0], time.monotonic_ns())
    assert flags(device) == {DeviceFlag.DISCONNECTED}
    device.close()
    with pytest.raises(DeviceUnavailableError, match=r"no port .* plug it in"):
        device.open()
    plug(OURS)
    drives(device, 40.0)
    assert flags(device) == set()
    device.close()


@pytest.mark.sees("thorlabs_mdt", "B1")
def test_unplugging_ends_an_exchange(adapter: str) -> None:
    """Unplugging during an exchange is a loss, not a time-out."""
    line = SerialLine(adapter, 115_200)
    line.open()
    puller = threading.Timer(0.2, unplug, (OURS,))
    puller.start()
    with pytest.raises(LineFault) as caught:
        line.receive(60 * SECOND_NS)
    puller.join()
    assert caught.value.flag is DeviceFlag.DISCONNECTED
    with pytest.raises(LineFault) as caught:
        line.send(b"x")
    assert caught.value.flag is DeviceFlag.DISCONNECTED
    line.close()


@pytest.mark.sees("thorlabs_mdt", "B2")
def test_other_path_is_detected(adapter: str) -> None:
    """The device is found by its lasting name at the kernel's new path."""
    device = amplifier(adapter)
    drives(device, 20.0)
    first = Path(adapter).resolve()
    unplug(OURS)
    assert not device.write([30.0], time.monotonic_ns())
    device.close()
    plug("OTHER", "nothing")
    assert path_of("OTHER").resolve() == first
    plug(OURS)
    drives(device, 40.0)
    assert Path(adapter).resolve() != first
    assert flags(device) == {DeviceFlag.OTHER_PATH}
    assert flags(device) == set()
    device.close()
    unplug("OTHER")


@pytest.mark.sees("thorlabs_mdt", "B2")
def test_old_descriptor_keeps_its_name(adapter: str) -> None:
    """An adapter that was plugged in again before the device was closed gets another path."""
    device = amplifier(adapter)
    drives(device, 20.0)
    first = Path(adapter).resolve()
    unplug(OURS)
    plug(OURS)
    assert not device.write([30.0], time.monotonic_ns())
    assert flags(device) == {DeviceFlag.DISCONNECTED}
    assert Path(adapter).resolve() != first
    device.close()
    drives(device, 40.0)
    assert flags(device) == {DeviceFlag.OTHER_PATH}
    device.close()
