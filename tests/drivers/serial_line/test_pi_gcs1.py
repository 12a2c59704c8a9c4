import re

import pytest

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.gcs.emulator import GcsEmulator
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.pi_gcs1.codec import Gcs1Syntax
from piezod_drivers.serial_line.pi_gcs1.dialogue import Gcs1Dialogue
from piezod_drivers.serial_line.pi_gcs1.driver import PLUGIN
from piezod_drivers.serial_line.pi_gcs1.emulator import EMULATOR
from piezod_drivers.serial_line.pi_gcs1.options import Gcs1Options
from tests.drivers.serial_line.linear_rig import UM_PER_V, LinearRig, bench
from tests.drivers.serial_line.scripted_line import EmulatedLine, ScriptedLine, exchange

OPTIONS = Gcs1Options(port="/dev/ttyS0")


def emulated(names: str = "A") -> tuple[ExchangingBusDevice, EmulatedLine, GcsEmulator, LinearRig]:
    """Return an open device on an emulated controller."""
    table, rig, time = bench(len(names))
    assert EMULATOR.create is not None
    emulator = EMULATOR.create(table, "")
    assert isinstance(emulator, GcsEmulator)
    line = EmulatedLine(emulator, time)
    device = ExchangingBusDevice("E-816", Gcs1Dialogue(line, OPTIONS, Wiring.both(names)))
    device.open()
    return device, line, emulator, rig


def test_the_bytes_of_a_cycle() -> None:
    """Letters directly precede values, and replies are bare values."""
    line = ScriptedLine(
        exchange(b"ERR?\n", b"-1\n"),  # the error of a controller after power-up
        exchange(b"*IDN?\nERR?\n", b"Physik Instrumente,E-816,107,3.20\n0\n"),
        exchange(b"SAI?\nERR?\n", b"A\n0\n"),
        exchange(b"SVO? A\nERR?\n", b"0\n", b"0\n"),
        exchange(b"POS? A\nSVA A2.5000\nVOL? A\nERR?\n", b"+0005.2500\n", b"+0033.1000\n", b"0\n"),
    )
    device = ExchangingBusDevice("E-816", Gcs1Dialogue(line, OPTIONS, Wiring.both(["A"])))
    assert device.open() == ("Physik Instrumente", "E-816", "107", "3.20")
    device.activate(0)
    taken, samples = device.exchange([2.5], 1)
    assert (taken, samples[0].position_um, device.read_back(1)) == (True, 5.25, [33.1])
    line.assert_done()


def test_two_axes_in_one_write() -> None:
    """Each axis has lines of its own, and one write sends all of them."""
    device, line, _, rig = emulated("AB")
    device.activate(0)
    line.sent.clear()
    assert device.write([10.0, 20.0], 1)
    assert line.sent == [b"SVA A10.0000\nSVA B20.0000\nERR?\n"]
    assert rig.drive_v == [10.0, 20.0]
    assert [s.position_um for s in device.read(2)] == pytest.approx([10 * UM_PER_V, 20 * UM_PER_V])
    assert device.read_back(2) == [10.0, 20.0]


@pytest.mark.sees("pi_gcs1", "A8")
def test_activation_and_a_servo() -> None:
    """The servo is switched off at its voltage; switched on again, it is reported."""
    device, line, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].servo = 40.0, True
    device.activate(0)
    assert b"SVO A0\nSVA A40.0000\nERR?\n" in line.sent
    assert rig.drive_v == [40.0]
    emulator.axes[0].servo = True
    assert not device.write([5.0], 1)
    assert DeviceFlag.LOCAL_MODE in device.status(1)[1]


@pytest.mark.sees("pi_gcs1", "B10")
@pytest.mark.sees("pi_gcs1", "A13")
@pytest.mark.sees("pi_gcs1", "A1")
@pytest.mark.parametrize(
    ("code", "flag"),
    [(b"603", DeviceFlag.OVER_TEMPERATURE), (b"2", DeviceFlag.WRONG_REQUEST)],
)
def test_errors_of_the_controller(code: bytes, flag: DeviceFlag) -> None:
    """An error in place of the acknowledgement fails the write with its flag."""
    device, line, _, _ = emulated()
    device.activate(0)
    line.change = lambda _: code + b"\n"
    assert not device.write([2.0], 1)
    assert flag in device.status(1)[1]


def test_configurations() -> None:
    """A range must rise; channels are the axes, in µm and V; the line limits the rate."""
    with pytest.raises(ValueError, match="must be above the first"):
        Gcs1Options(port="x", range_v=(10.0, 10.0))
    assert PLUGIN.channels(OPTIONS) == ({"A": "µm"}, {"A": "V"})
    slow = Gcs1Options(port="x", baud=38_400)
    dialogue = Gcs1Dialogue(ScriptedLine(), slow, Wiring.both(["A"]))
    assert dialogue.capabilities().max_rate_hz == pytest.approx(61, abs=1)
    PLUGIN.create(OPTIONS, Wiring.both(["A"]), 1).close()


def test_requests_of_two_other_programs_are_answered_as_they_expect() -> None:
    """The emulated E-816 answers the requests of EPICS (`drvPIE816.cc`) and of PYME as they parse.

    EPICS finds the axes by `POS?` of A, B, … until one has no reply. It reads a number of bare text
    and a switch of one digit. PYME finds the firmware by a V before it.
    """
    _, _, emulator, rig = emulated("AB")
    rig.drive_v[0] = 10.0
    ask = emulator.receive
    position = ask(b"POS? A\n")[0]
    assert float(position) == pytest.approx(10.0 * UM_PER_V)
    assert [len(ask(b"POS? %s\n" % axis)) for axis in (b"B", b"C")] == [1, 0]
    ask(b"ERR?\n")
    assert ask(b"SVO A1\nSVO? A\nSVO A0\nSVO? A\n") == [b"1\n", b"0\n"]
    assert re.findall(rb"V(\d\.\d\d)", ask(b"*IDN?\n")[0]) == [b"3.20"]


@pytest.mark.parametrize("text", [b"1.050000e+1", b"+1.05e+001", b"+0010.5000"])
def test_numbers_with_exponents_are_read(text: bytes) -> None:
    """A number as an E-516 writes it, `1.050000e+1`, is read (`README_PIE516` of EPICS)."""
    reply = GcsReply(*Gcs1Syntax().numbers(["A"]))
    assert reply.numbers(text + b"\n0\n") == [10.5]
