import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.emulation.emulator import Emulator, HearsConnections
from piezod_drivers.serial_line.pi_gcs1.emulator import EMULATOR as E816
from piezod_drivers.serial_line.pi_gcs2.emulator import EMULATOR, EMULATOR_TCP, Gcs2Emulator
from tests.drivers.serial_line.linear_rig import LinearRig, bench


def gcs2(n_axes: int = 2) -> tuple[Gcs2Emulator, LinearRig]:
    """Return a controller and the rig that it drives."""
    table, rig, _ = bench(n_axes)
    return Gcs2Emulator(table, ""), rig


def e816() -> tuple[Emulator, LinearRig]:
    """Return a controller with axes A and B, and the rig that it drives."""
    table, rig, _ = bench(2)
    assert E816.create is not None
    return E816.create(table, ""), rig


def error_of(emulator: Emulator, request: bytes) -> int:
    """Send a command without reply and return the error."""
    assert emulator.receive(request) == []
    (reply,) = emulator.receive(b"ERR?\n")
    assert emulator.receive(b"ERR?\n") == [b"0\n"]
    return int(reply)


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        (b"POS? 1\n", b"1=0.000000\n"),
        (b"POS? 2 1\n", b"2=0.000000 \n1=0.000000\n"),
        (b"pos?\n", b"1=0.000000 \n2=0.000000\n"),
        (b"SVO? 1\n", b"1=0\n"),
        (b"ONL? 2\n", b"2=1\n"),
        (b"SAI?\n", b"1 \n2\n"),
        (b"VMA? 1\n", b"1=150.000000\n"),
        (b"TMX? 1\n", b"1=30.000000\n"),
        (b"TMN? 1\n", b"1=0.000000\n"),
        (b"\x07", b"\xb1\n"),
        (b"\x05", b"0\n"),
    ],
)
def test_replies(request_: bytes, reply: bytes) -> None:
    """A query has a line for each item, all but the last with a space at the end."""
    assert gcs2()[0].receive(request_) == [reply]


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (b"XYZ?\n", 2),
        (b"SVA 3 1\n", 15),
        (b"POS? 9\n", 15),
        (b"SVA 1\n", 24),
        (b"SVA\n", 24),
        (b"SVA 1 much\n", 25),
        (b"SVA 1 1_0\n", 25),
        (b"SVA 1 200\n", 17),
        (b"SVO 1 2\n", 17),
        (b"\x18", 10),
        (b"A" * 2000 + b"\n", 3),
    ],
)
def test_errors(request_: bytes, code: int) -> None:
    """A refused command has no reply, drives nothing, and its error is reported once."""
    emulator, rig = gcs2()
    assert error_of(emulator, request_) == code
    assert rig.drive_v == [0.0, 0.0]


def test_all_or_nothing() -> None:
    """A setting of two axes with one error changes none of them."""
    emulator, rig = gcs2()
    assert error_of(emulator, b"SVA 1 5 2 999\n") == 17
    assert rig.drive_v == [0.0, 0.0]
    assert error_of(emulator, b"SVA 1 5 2 -3.5\n") == 0
    assert rig.drive_v == [5.0, -3.5]


def test_servo_and_online_mode() -> None:
    """With the servo on `SVA` is refused; offline it is stored and takes effect online."""
    emulator, rig = gcs2()
    assert error_of(emulator, b"SVO 1 1\nSVA 1 5\n") == 79
    assert error_of(emulator, b"SVO 1 0\nONL 1 0\nSVA 1 5\n") == 0
    assert rig.drive_v[0] == 0.0
    assert error_of(emulator, b"ONL 1 1\n") == 0
    assert rig.drive_v[0] == 5.0


def test_an_amplifier_that_cannot() -> None:
    """A voltage that the rig refuses has its own error."""
    emulator, rig = gcs2()
    rig.highest_v = 100.0
    assert error_of(emulator, b"SVA 1 120\n") == 302


def test_lines_may_come_in_parts() -> None:
    """A command runs at its line feed; a new connection discards an incomplete one."""
    emulator, _ = gcs2(1)
    assert emulator.receive(b"PO") == []
    assert emulator.receive(b"S? 1\n\n") == [b"1=0.000000\n"]
    emulator.receive(b"PO")
    assert isinstance(emulator, HearsConnections)
    emulator.connected()
    assert emulator.receive(b"POS? 1\n") == [b"1=0.000000\n"]
    assert emulator.due() == []


def test_the_first_generation() -> None:
    """The E-816 puts letters before values, replies bare values, and has its own errors."""
    emulator, rig = e816()
    assert error_of(emulator, b"SVA A12.5B3\n") == 0
    assert rig.drive_v == [12.5, 3.0]
    assert emulator.receive(b"VOL? A\nSAI?\nSVO? B\n") == [b"+0012.5000\n", b"AB\n", b"0\n"]
    assert error_of(emulator, b"SVO A1\nSVA A1\n") == 303
    assert error_of(emulator, b"POS?\n") == 26
    assert error_of(emulator, b"SVA A\n") == 24
    assert error_of(emulator, b"ONL 1\n") == 2


def test_the_serial_number() -> None:
    """A given serial number is reported, over both wires."""
    for plugin in (EMULATOR, EMULATOR_TCP, E816):
        assert plugin.create is not None
        table, _, _ = bench()
        (answer,) = plugin.create(table, "S-77").receive(b"*IDN?\n")
        assert b"S-77" in answer


@given(st.lists(st.binary(max_size=60) | st.sampled_from([b"SVA 1 5\n", b"POS?\n"]), max_size=20))
def test_any_bytes(chunks: list[bytes]) -> None:
    """The controllers continue to reply after any bytes."""
    for emulator in (gcs2()[0], e816()[0]):
        for chunk in chunks:
            emulator.receive(chunk)
        emulator.receive(b"\nERR?\n")
        assert emulator.receive(b"ERR?\n") == [b"0\n"]
