"""The status of piezosystem jena's amplifiers."""

import pytest

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj.profiles import ProfileName
from tests.drivers.serial_line.psj_rig import Rig
from tests.drivers.serial_line.scripted_line import MS


@pytest.mark.sees("psj", "A4")
@pytest.mark.sees("psj", "A8")
@pytest.mark.sees("psj", "A11")
@pytest.mark.sees("psj", "A13")
@pytest.mark.sees("psj", "B10")
@pytest.mark.parametrize(
    ("profile", "bits", "flag"),
    [
        ("ddrive", 1 << 0, DeviceFlag.SHORT_OR_OPEN),
        ("ddrive", 1 << 6, DeviceFlag.LOCAL_MODE),
        ("ddrive", 1 << 7, DeviceFlag.LOCAL_MODE),
        ("ddrive", 1 << 10, DeviceFlag.LOCAL_MODE),
        ("nv40", 0x1, DeviceFlag.SHORT_OR_OPEN),
        ("nv40", 0x2, DeviceFlag.SHORT_OR_OPEN),
        ("nv40", 0x10, DeviceFlag.DEVICE_FAILURE),
        ("nv40", 0x1000, DeviceFlag.OVERLOAD),
        ("nv40", 0x2000, DeviceFlag.OVERLOAD),
        ("nv40", 0x4000, DeviceFlag.OTHER_DEVICE),
        ("nv40", 0x8000, DeviceFlag.OVER_TEMPERATURE),
        ("nv200", 1 << 0, DeviceFlag.SHORT_OR_OPEN),
        ("nv200", 1 << 3, DeviceFlag.LOCAL_MODE),
        ("nv200", 1 << 10, DeviceFlag.OVER_TEMPERATURE),
        ("nv200", 1 << 11, DeviceFlag.SHORT_OR_OPEN),
        ("nv200", 1 << 12, DeviceFlag.DEVICE_FAILURE),
    ],
)
def test_status_bits_become_flags_within_a_tenth_of_a_second(
    profile: ProfileName, bits: int, flag: DeviceFlag
) -> None:
    """A fault in the status word is reported as long as it lasts."""
    rig = Rig(profile)
    rig.started()
    assert frozenset() == rig.flags()

    rig.emulator.fault_bits = bits
    _write_twice(rig)
    assert {flag} == rig.flags()

    rig.emulator.fault_bits = 0
    _write_twice(rig)
    assert frozenset() == rig.flags()


def _write_twice(rig: Rig) -> None:
    """Write twice within a tenth of a second."""
    for _ in range(2):
        rig.time.t_ns += 50 * MS
        rig.device.write([1.0], rig.now_ns())


@pytest.mark.sees("psj", "A8")
def test_local_control_of_an_nv40_is_reported() -> None:
    """A channel that is given back to its knob is reported until the port has it again."""
    rig = Rig("nv40")
    rig.started()
    rig.send(b"setk,0,0\r")
    _write_twice(rig)
    assert {DeviceFlag.LOCAL_MODE} == rig.flags()

    rig.send(b"setk,0,1\r")
    _write_twice(rig)
    assert frozenset() == rig.flags()


def test_the_status_is_asked_after_a_setpoint_and_seldom() -> None:
    """A setpoint never waits for a status, and most cycles have none."""
    rig = Rig("nv200")
    device = rig.started()

    for _ in range(3):
        device.write([5.0], rig.now_ns())
        rig.time.t_ns += 60 * MS

    setpoint = b"set,5.000\r"
    assert [setpoint, setpoint, setpoint, b"stat\r"] == rig.line.sent


def test_the_channels_take_turns_with_their_status() -> None:
    """With more channels the status of each is still read within 0.1 s."""
    rig = Rig("ddrive", wiring=Wiring((), ("ch0", "ch2")))
    device = rig.started()

    for _ in range(4):
        rig.time.t_ns += 50 * MS
        device.write([5.0, 6.0], rig.now_ns())

    asked = [sent for sent in rig.line.sent if sent.startswith(b"stat")]
    assert {b"stat,0\r\n", b"stat,2\r\n"} == set(asked[:2]) == set(asked[2:])


def test_a_status_that_fails_does_not_refuse_the_setpoint_before_it() -> None:
    """A failed status request does not fail the acknowledged setpoint before it."""
    rig = Rig("nv200")
    device = rig.started()
    rig.line.change = lambda reply: b"" if b"stat" in reply else reply
    rig.time.t_ns += 100 * MS

    assert device.write([5.0], rig.now_ns())
    assert DeviceFlag.LATE_REPLY in rig.flags()


@pytest.mark.parametrize(
    "flag", [DeviceFlag.PARTIAL_WRITE, DeviceFlag.DISCONNECTED, DeviceFlag.HALF_OPEN]
)
def test_after_half_a_question_for_the_status_nothing_is_sent(
    monkeypatch: pytest.MonkeyPatch, flag: DeviceFlag
) -> None:
    """Half a sent status request loses the device: no setpoint follows it."""
    rig = Rig("nv200")
    device = rig.started()
    rig.time.t_ns += 100 * MS
    send = rig.line.send

    def fail(data: bytes) -> None:
        if data.startswith(b"stat"):
            raise LineFault(flag, "the line is lost")
        send(data)

    monkeypatch.setattr(rig.line, "send", fail)

    assert not device.write([5.0], rig.now_ns())
    assert not device.write([6.0], rig.now_ns())
    assert rig.line.sent == [b"set,5.000\r"]
    assert flag in rig.flags()


@pytest.mark.sees("psj", "B10")
@pytest.mark.parametrize(
    ("profile", "error", "flag"),
    [
        ("ddrive", b"command not found", DeviceFlag.WRONG_REQUEST),
        ("ddrive", b"unit not available", DeviceFlag.SHORT_OR_OPEN),
        ("nv40", b"ErrorCode,18", DeviceFlag.WRONG_REQUEST),
        ("nv40", b"ErrorCode,25", DeviceFlag.SHORT_OR_OPEN),
        ("nv40", b"ErrorCode,99", DeviceFlag.DEVICE_FAILURE),
        ("nv200", b"error,6", DeviceFlag.LOCAL_MODE),
        ("nv200", b"error,8", DeviceFlag.OVERLOAD),
    ],
)
def test_a_setpoint_that_the_device_refuses_is_refused(
    profile: ProfileName, error: bytes, flag: DeviceFlag
) -> None:
    """An error in place of an acknowledgement fails the write with its flag."""
    rig = Rig(profile)
    device = rig.started()
    rig.line.change = lambda _reply: b"\x13" + error + b"\r\n\x11"

    assert not device.write([5.0], rig.now_ns())
    assert flag in rig.flags()
