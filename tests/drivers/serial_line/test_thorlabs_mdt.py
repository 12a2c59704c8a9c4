from math import isnan

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.thorlabs_mdt.dialogue import MdtDialogue
from piezod_drivers.serial_line.thorlabs_mdt.driver import PLUGIN
from piezod_drivers.serial_line.thorlabs_mdt.emulation.a_model import MdtAEmulator
from piezod_drivers.serial_line.thorlabs_mdt.emulator import (
    MDT693A,
    MDT693B,
    MDT694B,
    MdtEmulator,
    MdtModel,
)
from piezod_drivers.serial_line.thorlabs_mdt.options import MdtOptions
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import (
    MANY,
    EmulatedLine,
    ScriptedLine,
    Step,
    exchange,
)

B3 = MdtModel("MDT693B", "XYZ", "2.09")
B1 = MdtModel("MDT694B", "X", "2.09")
A3 = None  # the only A model that is emulated
TIMEOUT_S = 0.1


def emulated(
    model: MdtModel | None, outputs: str, change_mode: bool = False
) -> tuple[BusDevice, EmulatedLine, MdtEmulator | MdtAEmulator, LinearRig]:
    """Return an open and active device on an emulated amplifier."""
    table, rig, time = bench(len(model.axes) if model else 3)
    emulator = MdtEmulator(model, table, "") if model else MdtAEmulator(table, "")
    if isinstance(emulator, MdtEmulator):
        emulator.compatible |= change_mode
    line = EmulatedLine(emulator, time)
    device = BusDevice("MDT", MdtDialogue(line, TIMEOUT_S, Wiring((), tuple(outputs))))
    device.open()
    device.activate(0)
    line.sent.clear()
    return device, line, emulator, rig


@pytest.mark.parametrize(
    ("model", "change_mode", "outputs", "put", "get"),
    [
        (B1, False, "x", [b"XVOLTAGE=12.500\r"], [b"XVOLTAGE?\r"]),
        (B3, False, "y", [b"YVOLTAGE=12.500\r"], [b"YVOLTAGE?\r"]),
        (B3, True, "x", [b"XVOLTAGE=12.500\r"], [b"XVOLTAGE?\r"]),
        (A3, False, "z", [b"ZV12.500\r"], [b"ZR?\r"]),
    ],
)
def test_one_output(
    model: MdtModel | None, change_mode: bool, outputs: str, put: list[bytes], get: list[bytes]
) -> None:
    """Each model and mode is set and read back by its own commands."""
    device, line, emulator, rig = emulated(model, outputs, change_mode)
    assert not emulator.echo
    assert device.write([12.5], 1)
    assert rig.drive_v["xyz".index(outputs)] == 12.5
    assert device.read_back(1) == [12.5]
    assert line.sent == put + get
    assert device.read(1) == []
    assert device.status(1) == [frozenset()]


def test_three_outputs_at_once() -> None:
    """One command sets all axes of a B model and one reads them, in any order of names."""
    device, line, _, rig = emulated(B3, "zxy")
    assert device.write([3.0, 1.0, 2.0], 1)
    assert rig.drive_v == [1.0, 2.0, 3.0]
    assert device.read_back(1) == [3.0, 1.0, 2.0]
    assert line.sent == [b"XYZVOLTAGE=1.000,2.000,3.000\r", b"XYZVOLTAGE?\r"]


@pytest.mark.parametrize("model", [A3, MdtModel("MDT693B", "XYZ", "1.05")])
def test_three_outputs_one_by_one(model: MdtModel | None) -> None:
    """Without a command for all axes, each axis has its own."""
    device, line, _, rig = emulated(model, "xyz")
    assert device.write([3.0, 1.0, 2.0], 1)
    assert rig.drive_v == [3.0, 1.0, 2.0]
    assert device.read_back(1) == [3.0, 1.0, 2.0]
    assert len(line.sent) == 6


def test_opening_moves_nothing() -> None:
    """Opening, activating and closing keep the outputs."""
    table, rig, time = bench(3)
    rig.drive_v = [10.0, 20.0, 30.0]
    line = EmulatedLine(MdtEmulator(B3, table, "S-1"), time)
    device = BusDevice("MDT", MdtDialogue(line, TIMEOUT_S, Wiring((), ("x", "y", "z"))))
    assert device.open() == ("Thorlabs", "MDT693B", "S-1", "2.09")
    assert device.capabilities().holds
    device.activate(0)
    device.close()
    assert rig.drive_v == [10.0, 20.0, 30.0]


@pytest.mark.parametrize("value", [-0.001, 150.001, float("nan")])
def test_beyond_the_range(value: float) -> None:
    """A voltage beyond the switch's limit is refused without asking the amplifier."""
    device, line, _, _ = emulated(B3, "x")
    assert not device.write([value], 1)
    assert line.sent == []


@pytest.mark.sees("thorlabs_mdt", "B10")
@pytest.mark.sees("thorlabs_mdt", "A1")
@pytest.mark.parametrize(("model", "reply"), [(B3, b"CMD_ARG_INVALID>"), (A3, b"!")])
def test_the_amplifier_refuses(model: MdtModel | None, reply: bytes) -> None:
    """An error in place of the prompt fails the write with its flag."""
    device, line, _, _ = emulated(model, "x")
    line.change = lambda _: reply
    assert not device.write([1.0], 1)
    assert device.status(1) == [frozenset({DeviceFlag.WRONG_REQUEST})]
    assert isnan(device.read_back(2)[0])


@pytest.mark.sees("thorlabs_mdt", "A7")
@pytest.mark.parametrize("model", [B3, A3])
def test_a_restart(model: MdtModel | None) -> None:
    """An amplifier that echoes commands again has restarted; activated again, it is silent."""
    device, _, emulator, _ = emulated(model, "x")
    emulator.echo = True
    assert device.write([1.0], 1)
    assert device.status(1) == [frozenset({DeviceFlag.RESTARTED})]
    assert device.read_back(2) == [1.0]
    device.deactivate(3)
    device.activate(4)
    device.status(4)
    assert not emulator.echo
    assert device.read_back(5) == [1.0]
    assert device.status(5) == [frozenset()]


@pytest.mark.parametrize("model", [B3, A3])
def test_many_exchanges_report_nothing(model: MdtModel | None) -> None:
    """Nothing in the replies of either generation is taken for a fault."""
    device, _, _, rig = emulated(model, "xz")
    for i in range(20):
        assert device.write([float(i), 20.0 + i], i)
        assert device.read_back(i) == [float(i), 20.0 + i]
        assert device.status(i) == [frozenset()] * 2
    assert rig.drive_v == [19.0, 0.0, 39.0]


def test_a_silent_amplifier_is_left_silent() -> None:
    """The command that toggles the echo is not sent to an amplifier that does not echo."""
    table, _, time = bench(3)
    emulator = MdtAEmulator(table, "")
    emulator.echo = False
    line = EmulatedLine(emulator, time)
    BusDevice("MDT", MdtDialogue(line, TIMEOUT_S, Wiring((), ("x",)))).open()
    assert b"E\r" not in line.sent
    assert not emulator.echo


@pytest.mark.sees("thorlabs_mdt", "A3")
@pytest.mark.sees("thorlabs_mdt", "A12")
def test_the_voltage_is_measured() -> None:
    """The read-back is the voltage of the amplifier, not the written value."""
    device, _, _, rig = emulated(B3, "x")
    assert device.write([10.0], 1)
    rig.drive_v[0] = 155.0
    assert device.read_back(2) == [155.0]


def device_on(line: ScriptedLine, outputs: str = "x") -> BusDevice:
    """Return a device on a script."""
    return BusDevice("MDT", MdtDialogue(line, TIMEOUT_S, Wiring((), tuple(outputs))))


def test_the_first_firmware_of_a_b_model() -> None:
    """A B model whose replies end like an A model's is driven by its own commands."""
    line = ScriptedLine(
        exchange(b"~\r", b"\r*"),
        exchange(b"ID?\r", b"ID?\r", b"*\r\r\rModel MDT693B Piezo\rFirmware Version: 1.05\r"),
        exchange(b"XVOLTAGE?\r", b"XVOLTAGE?\r*[  24.8]\r"),
        exchange(b"ECHO=0\r", b"ECHO=0\r*"),
        exchange(b"XVOLTAGE?\r", b"*[  24.8]\r"),
        exchange(b"VLIMIT?\r", b"*[ 100]\r*"),
        exchange(b"XMIN?\r", b"*0"),
        exchange(b"XMAX?\r", b"*100.5"),
        exchange(b"XVOLTAGE=24.680\r", b"*"),
        exchange(b"XVOLTAGE?\r", b"*[  24.8]\r"),
    )
    device = device_on(line)
    device.open()
    device.activate(0)
    assert not device.write([100.1], 1)
    assert device.write([24.68], 1)
    assert device.read_back(1) == [24.8]
    line.assert_done()


def test_silent_device() -> None:
    """A port without reply is an unavailable device, and the port is closed."""
    line = ScriptedLine(*MANY * [exchange(b"~\r")])
    with pytest.raises(DeviceUnavailableError, match="no reply within 500 ms"):
        device_on(line).open()
    assert not line.opened


@pytest.mark.parametrize(
    ("steps", "what"),
    [
        (MANY * [exchange(b"~\r", b"hello")], "does not reply like an MDT"),
        (
            [exchange(b"~\r", b">"), exchange(b"ID?\r", b"BPC>"), exchange(b"I\r", b"?>")],
            "is no MDT693",
        ),
        ([exchange(b"~\r", b">"), exchange(b"ID?\r", b"Model MDT694B>")], "has axes x, but not y"),
    ],
)
def test_another_device(steps: list[Step], what: str) -> None:
    """A device that is no MDT, or lacks a configured axis, is refused and its port closed."""
    line = ScriptedLine(*steps)
    with pytest.raises(DeviceError, match=what):
        device_on(line, "y").open()
    assert not line.opened


@pytest.mark.parametrize(
    ("steps", "what"),
    [
        ([exchange(b"XVOLTAGE?\r", b"CMD_NOT_DEFINED>")], "reports no voltage"),
        (
            [exchange(b"XVOLTAGE?\r", b"[ 0.0]\r>"), exchange(b"VLIMIT?\r", b"Error>")],
            "answers VLIMIT",
        ),
    ],
)
def test_a_device_that_does_not_tell(steps: list[Step], what: str) -> None:
    """An MDT that does not report its voltage or its limits is refused."""
    begin = (
        exchange(b"~\r", b">"),
        exchange(b"ID?\r", b"Model MDT693B>"),
    )
    with pytest.raises(DeviceError, match=what):
        device_on(ScriptedLine(*begin, *steps)).open()


def test_the_plug_in() -> None:
    """The driver has three outputs in V and no input; construction opens nothing."""
    options = MdtOptions(port="/dev/ttyUSB0")
    assert PLUGIN.channels(options) == ({}, {"x": "V", "y": "V", "z": "V"})
    PLUGIN.create(options, Wiring((), ("x",)), 1).close()
    assert [plugin.name for plugin in (MDT693A, MDT693B, MDT694B)] == [
        "mdt693a",
        "mdt693b",
        "mdt694b",
    ]
