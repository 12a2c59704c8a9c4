"""A text device that answers otherwise than its configuration says: which bytes came."""

import pytest

from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from tests.drivers.serial_line.ascii_rig import started
from tests.drivers.serial_line.scripted_line import exchange

FORGOTTEN = {
    "set": ({"send": "V {x:.2f}"},),
    "read_back": ({"send": "V?", "reply": r"(?P<x>[\d.]+)"},),
}


def test_forgotten_reply_is_named_with_the_bytes_that_came() -> None:
    """A device that answers setpoints without a `reply` is refused once, with its answer."""
    cycle = (exchange(b"V 1.00\n"), exchange(b"V?\n", b"OK\r\n1.00\n"))
    dut, line = started(*cycle * 3, **FORGOTTEN)
    for _ in range(3):
        assert dut.write([1.0], line.now_ns())
        assert DeviceFlag.GARBAGE in dut.status(line.now_ns())[1]
    dut.deactivate(line.now_ns())

    with pytest.raises(
        DeviceError, match=r"'OK\\r\\n' \(4F 4B 0D 0A\).*has no `reply`: give it one"
    ):
        dut.activate(line.now_ns())
    dut.activate(line.now_ns())


def test_silent_setpoints_are_no_forgotten_reply() -> None:
    """Garbage now and then does not prevent activation."""
    good = (exchange(b"V 1.00\n"), exchange(b"V?\n", b"1.00\n"))
    noisy = (exchange(b"V 1.00\n"), exchange(b"V?\n", b"#\n1.00\n"))
    dut, line = started(*noisy * 2, *good, *noisy * 2, **FORGOTTEN)
    for _ in range(5):
        assert dut.write([1.0], line.now_ns())
    dut.deactivate(line.now_ns())

    dut.activate(line.now_ns())


def test_reading_that_does_not_match_is_shown() -> None:
    """The text of a failed read has the bytes that the device sent."""
    dut, line = started(exchange(b"P?\n", b"1,5 um\n"))

    assert not dut.read(line.now_ns())[0].valid
    assert "'1,5 um\\n' (31 2C 35 20 75 6D 0A)" in dut.last_fault
