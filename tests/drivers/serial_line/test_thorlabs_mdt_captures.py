"""Driver and emulators agree with what was captured at real amplifiers, and with their manuals.

The captures are facts from jekktmoeder/Thorlabs_MDT, `probe_mdt693a_results.txt` (c9ec5f7) and
`mdt_command_discovery_results.json` (288f044) of an MDT693A with firmware 3.01, an MDT693B and two
MDT694B with firmware 1.10. The author's program has stripped white space at the end of the latter.
"""

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.thorlabs_mdt.codec import identity_in, limit_of, number_in
from piezod_drivers.serial_line.thorlabs_mdt.dialogue import MdtDialogue
from piezod_drivers.serial_line.thorlabs_mdt.emulation.a_model import MdtAEmulator
from piezod_drivers.serial_line.thorlabs_mdt.emulator import MdtEmulator, MdtModel
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import ScriptedLine, exchange

A_IDENTITY = bytes.fromhex(
    "69646e3f0d2a20202020200d0d0d4d6f64656c204d445436393341205069657a6f20436f6e74726f6c204d6f64756c"
    "650d4669726d776172652056657273696f6e3a20332e30310d566f6c746167652052616e67653a20305620746f2031"
    "3530560d54686f726c6162732c20496e632e204e6577746f6e2c204e4a2030373836300d7777772e74686f726c6162"
    "732e636f6d0d0d0a"
)
"""Reply of the MDT693A to `IDN?` and CR LF."""
A_REPLIES = [
    ("XVOLTAGE?\r", "78766f6c746167653f0d2100"),
    ("*IDN?\r", "2a69646e3f0d2100"),
    ("ECHO=0\r", "6563686f3d300d2100"),
    ("ECHO=0\r\n", "6563686f3d300d210a"),
    ("MODEL?\r\n", "6d6f64656c3f0d21000a"),
    ("VER?\n", "7665723f0a"),
]
"""Requests, and the bytes that the MDT693A sent."""
B_IDENTITY = (
    b"Model MDT694B Piezo Control Module\rFirmware Version: 1.10\rVoltage Range: 0V to 150V\r"
    b"Serial#:%s\rFriendly Name:%s\rThorlabs, Inc. Newton, NJ 07860\rwww.thorlabs.com\r\r>"
)


@pytest.mark.parametrize(("request_", "captured"), A_REPLIES)
def test_emulated_a_model_replies_as_captured(request_: str, captured: str) -> None:
    """The emulated MDT693A echoes and refuses as the real one, whose NUL comes now and then."""
    table, _, _ = bench()
    got = b"".join(MdtAEmulator(table, "").receive(request_.encode()))
    assert got.replace(b"\0", b"") == bytes.fromhex(captured).replace(b"\0", b"")


def test_emulated_a_model_identifies_itself_as_captured() -> None:
    """The emulated MDT693A answers a word that begins with I by its identity."""
    table, _, _ = bench()
    assert b"".join(MdtAEmulator(table, "").receive(b"IDN?\r\n")) == A_IDENTITY


def test_emulated_a_model_drops_a_long_line_as_captured() -> None:
    """An LF ends no command, and the byte with the number 20 drops the line."""
    table, _, _ = bench()
    emulator = MdtAEmulator(table, "")
    assert emulator.receive(b"XVOLTAGE?\n") == [b"xvoltage?\n"]
    captured = bytes.fromhex("78766f6c746167653f0d496e76616c696420436f6d6d616e6421")
    assert emulator.receive(b"xvoltage?\r") == [captured]


def test_driver_drives_what_was_captured() -> None:
    """The driver opens and drives an MDT693A by its captured bytes, without an event.

    The reply to `E` is that of the public driver libics, and the codes of the limit are those of
    the manual (MDT693A, rev. F, p. 21).
    """
    line = ScriptedLine(
        exchange(b"~\r", b"~\r!\0"),
        exchange(b"ID?\r", A_IDENTITY[:2] + A_IDENTITY[3:-1]),
        exchange(b"XR?\r", b"xr?\r*[  40.6]\r"),
        exchange(b"E\r", b"e\r*[Echo Off]\r"),
        exchange(b"XR?\r", b"*[  40.6]\r"),
        exchange(b"%\r", b"*[ 1]\r"),
        exchange(b"XL?\r", b"*[   0.0]\r"),
        exchange(b"XH?\r", b"*[ 150.0]\r"),
        exchange(b"XV50.300\r", b"*", b"\0"),
        exchange(b"XR?\r", b"*[  50.3]\r"),
    )
    device = BusDevice("MDT", MdtDialogue(line, 0.1, Wiring((), ("x",))))
    assert device.open() == ("Thorlabs", "MDT693A", "unknown", "3.01")
    assert device.capabilities().ranges == ((0.0, 100.0),)
    device.activate(0)
    assert device.write([50.3], 1)
    assert device.read_back(1) == [50.3]
    assert device.status(1) == [frozenset()]
    line.assert_done()


@pytest.mark.parametrize(
    ("serial", "name", "found"),
    [(b"", b"", "unknown"), (b"140317-02", b"MDT694B", "140317-02")],
)
def test_identity_of_a_b_model(serial: bytes, name: bytes, found: str) -> None:
    """An MDT694B without a serial number has none; its next line is not taken for it."""
    captured = B_IDENTITY % (serial, name)
    assert identity_in(captured) == ("Thorlabs", "MDT694B", found, "1.10")


def test_emulated_b_model_replies_as_captured() -> None:
    """The emulated B model has the lines and the forms of numbers of the real one."""
    table, _, _ = bench(3)
    emulator = MdtEmulator(MdtModel("MDT694B", "X", "1.10"), table, "140317-02")
    emulator.receive(b"ECHO=0\r")
    (identity,) = emulator.receive(b"ID?\r")
    assert identity.lstrip() == B_IDENTITY % (b"140317-02", b"piezo")
    assert emulator.receive(b"XMAX?\rXMIN?\rHELP?\r") == [
        b"150.50\r>",
        b"0\r>",
        b"CMD_NOT_DEFINED>",
    ]


@pytest.mark.parametrize(
    ("reply", "limit_v"),
    [(b"0\r>", 75.0), (b"*[ 1]\r", 100.0), (b"2\r>", 150.0), (b"[ 100]\r>", 100.0)],
)
def test_limits_by_code_and_by_value(reply: bytes, limit_v: float) -> None:
    """A limit is a code (MDT693A manual, p. 21; MDT693B manual, ch. 7.3) or, in clients, volts."""
    number = number_in(reply, b"VLIMIT?\r")
    assert number is not None
    assert limit_of(number) == limit_v
