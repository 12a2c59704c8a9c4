import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.emulation.emulator import Emulator
from piezod_drivers.serial_line.thorlabs_mdt.emulator import MDT693A, MDT693B, MDT694B
from tests.drivers.serial_line.linear_rig import LinearRig, bench

PLUGINS = {"mdt693a": MDT693A, "mdt693b": MDT693B, "mdt694b": MDT694B}


def emulated(profile: str, n_axes: int = 3) -> tuple[Emulator, LinearRig]:
    """Return an amplifier without echo, and the rig that it drives."""
    table, rig, _ = bench(n_axes)
    create = PLUGINS[profile].create
    assert create is not None
    emulator = create(table, "")
    emulator.receive(b"E\r" if profile == "mdt693a" else b"ECHO=0\r")
    return emulator, rig


@pytest.mark.parametrize(
    ("profile", "request_", "reply"),
    [
        ("mdt693b", b"XVOLTAGE=12.3\r", b">"),
        ("mdt693b", b"xvoltage?\r", b"[  0.00]\r>"),
        ("mdt693b", b"XYZVOLTAGE?\r", b"[  0.00,  0.00,  0.00]\r>"),
        ("mdt693b", b"ZMAX?\r", b"150.50\r>"),
        ("mdt693b", b"VLIMIT?\r", b"[ 150]\r>"),
        ("mdt693b", b"SERIAL?\r", b"140421-07\r>"),
        ("mdt693b", b"CM?\r", b"[MDT693A Compatibility Mode Off]\r>"),
        ("mdt693b", b"\r", b"CMD_NOT_DEFINED>"),
        ("mdt693b", b"XVOLTAGE=151\r", b"CMD_ARG_INVALID>"),
        ("mdt693b", b"XVOLTAGE=-1\r", b"CMD_ARG_INVALID>"),
        ("mdt693b", b"XVOLTAGE=1e1\r", b"CMD_ARG_INVALID>"),
        ("mdt693b", b"XYZVOLTAGE=1,2\r", b"CMD_ARG_INVALID>"),
        ("mdt693b", b"ECHO=2\r", b"CMD_ARG_INVALID>"),
        ("mdt693b", b"XR?\r", b"[  0.00]\r>"),
        ("mdt694b", b"YVOLTAGE?\r", b"CMD_NOT_DEFINED>"),
        ("mdt694b", b"XYZVOLTAGE?\r", b"CMD_NOT_DEFINED>"),
        ("mdt693b", b"XVOLTAGE?\n", b"[  0.00]\r>"),
        ("mdt693b", b"XVOLTAGE?\r\n", b"[  0.00]\r>"),
        ("mdt693b", b"XVOLTAGE?\n\r", b"[  0.00]\r>"),
        ("mdt693a", b"XV12.345\r", b"*\0"),
        ("mdt693a", b"AV12.345\r", b"*\0"),
        ("mdt693a", b"XR?\r", b"*[   0.0]\r"),
        ("mdt693a", b"%\r", b"*[ 2]\r"),
        ("mdt693a", b"E\r", b"*[Echo On]\r"),
        ("mdt693a", b"E0\r", b"!\0"),
        ("mdt693a", b"XV151\r", b"!\0"),
        ("mdt693a", b"WV1\r", b"!\0"),
        ("mdt693a", b"\r", b"!\0"),
    ],
)
def test_replies(profile: str, request_: bytes, reply: bytes) -> None:
    """B models end a reply with >, an A model begins it with *; both report errors."""
    emulator, _ = emulated(profile)
    assert emulator.receive(request_) == [reply]
    assert emulator.due() == []


def test_driven_voltage() -> None:
    """Voltages reach the axes by name; a command for all axes takes effect as a whole or not."""
    emulator, rig = emulated("mdt693b")
    emulator.receive(b"XVOLTAGE=1\rYVOLTAGE=2\nZ")
    assert rig.drive_v == [1.0, 2.0, 0.0]
    emulator.receive(b"\rXYZVOLTAGE=4,5,6\rXYZVOLTAGE=7,8,200\r")
    assert rig.drive_v == [4.0, 5.0, 6.0]
    rig.highest_v = 100.0
    assert emulator.receive(b"XVOLTAGE=120\r") == [b"CMD_ARG_INVALID>"]


def test_echo_is_on_at_first() -> None:
    """After power-up the echo is on."""
    table, _, _ = bench()
    assert MDT694B.create is not None
    emulator = MDT694B.create(table, "S-9")
    assert emulator.receive(b"xvoltage?\r") == [b"xvoltage?\r[  0.00]\r>"]
    (answer,) = emulator.receive(b"ID?\r")
    assert b"Model MDT694B" in answer
    assert b"S-9" in answer


def test_compatibility_mode() -> None:
    """A B model in compatibility mode ends its replies with * and reports errors by !."""
    emulator, _ = emulated("mdt693b")
    assert emulator.receive(b"CM=1\r") == [b"[MDT693A Compatibility Mode On]\r*"]
    assert emulator.receive(b"XV5\rXR?\rQ\r") == [b"*", b"[  5.00]\r*", b"!"]


@given(st.lists(st.binary(max_size=60) | st.sampled_from([b"XVOLTAGE=1\r", b"XR?\r"]), max_size=20))
def test_any_bytes(chunks: list[bytes]) -> None:
    """The amplifiers continue to reply after any bytes."""
    for profile in PLUGINS:
        emulator, _ = emulated(profile)
        for chunk in chunks:
            emulator.receive(chunk)
        emulator.receive(b"\n\r\r")
        assert len(emulator.receive(b"XR?\r")) == 1
