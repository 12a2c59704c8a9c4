"""A PI controller whose replies differ from the protocol: the message has the bytes that came."""

from collections.abc import Callable

import pytest

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.serial_line.pi_gcs1.dialogue import Gcs1Dialogue
from piezod_drivers.serial_line.pi_gcs1.emulator import EMULATOR
from piezod_drivers.serial_line.pi_gcs1.options import Gcs1Options
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.pi_gcs2_bench import emulated
from tests.drivers.serial_line.scripted_line import EmulatedLine


def with_cr(reply: bytes) -> bytes:
    """Return a reply with CR LF, as a serial server may make of it."""
    return reply.replace(b"\n", b"\r\n")


def with_space(reply: bytes) -> bytes:
    """Return a reply with a space at the end, which announces another line."""
    return reply.replace(b"\n", b" \n")


def e816(change: Callable[[bytes], bytes]) -> tuple[ExchangingBusDevice, EmulatedLine]:
    """Return a device on an emulated E-816 whose replies are changed, and the line to it."""
    table, _, time = bench()
    assert EMULATOR.create is not None
    line = EmulatedLine(EMULATOR.create(table, ""), time)
    line.change = change
    options = Gcs1Options(port="/dev/ttyS0")
    return ExchangingBusDevice("E-816", Gcs1Dialogue(line, options, Wiring.both("A"))), line


@pytest.mark.parametrize(
    ("change", "came"),
    [(with_cr, r"'0\\r\\n' \(30 0D 0A\)"), (with_space, r"'0 \\n' \(30 20 0A\)")],
)
def test_opening_says_what_came(change: Callable[[bytes], bytes], came: str) -> None:
    """A reply with one byte too many is no silence: the error shows it."""
    device, _ = e816(change)
    with pytest.raises(DeviceUnavailableError, match=f"no reply.*what came does not fit: {came}"):
        device.open()


def test_failed_sample_says_what_came() -> None:
    """Of a failed cycle the device keeps a text with the bytes, also while a reply is owed."""
    device, line, _, _ = emulated()
    device.activate(0)
    line.change = with_cr
    for _ in range(2):
        assert not device.read(1)[0].valid
        assert r"'1=0.000000\r\n" in device.last_fault
    assert DeviceFlag.LATE_REPLY in device.status(1)[0]
