"""Setpoints and samples of piezosystem jena's amplifiers."""

import pytest

from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj.profiles import ProfileName
from tests.drivers.serial_line.linear_rig import UM_PER_V
from tests.drivers.serial_line.psj_rig import ALL, Rig
from tests.drivers.serial_line.scripted_line import MS


@pytest.mark.parametrize("profile", ALL)
def test_a_voltage_that_is_set_is_at_the_actuator(profile: ProfileName) -> None:
    """Every model drives the written voltage and confirms it."""
    rig = Rig(profile)

    assert rig.started().write([12.5], rig.now_ns())
    assert rig.rig.drive_v[:1] == [12.5]


@pytest.mark.parametrize("profile", ["nv40", "nv200"])
def test_a_position_is_read_in_um(profile: ProfileName) -> None:
    """A closed-loop model reports the displacement of its actuator in open loop too."""
    rig = Rig(profile)
    device = rig.started()
    device.write([50.0], rig.now_ns())

    (sample,) = device.read(rig.now_ns())

    assert (sample.position_um, sample.valid) == (50.0 * UM_PER_V, True)


def test_nv200_reports_its_setpoint() -> None:
    """The setpoint of an NV200 is read from the device."""
    rig = Rig("nv200")
    device = rig.started()
    device.write([12.5], rig.now_ns())
    rig.send(b"set,3\r")

    assert device.read_back(rig.now_ns()) == [3.0]


def test_a_setpoint_makes_earlier_readings_old() -> None:
    """After a setpoint the value in force is read again, even at the same instant."""
    rig = Rig("nv200")
    device = rig.started()
    now_ns = rig.now_ns()
    before = device.read_back(now_ns)
    device.write([5.0], now_ns)

    assert (before, device.read_back(now_ns)) == ([0.0], [5.0])


@pytest.mark.sees("psj", "S6")
def test_a_d_drives_reading_carries_the_instant_of_its_refresh() -> None:
    """A d-Drive's reading keeps its instant until the next refresh."""
    rig = Rig("ddrive", "position")
    device = rig.started()
    device.read(rig.now_ns())
    device.write([10.0], rig.now_ns())
    rig.time.t_ns += 600 * MS
    (fresh,) = device.read(fresh_ns := rig.now_ns())
    device.write([20.0], rig.now_ns())

    rig.time.t_ns += 300 * MS
    (old,) = device.read(rig.now_ns())
    rig.time.t_ns += 300 * MS
    (new,) = device.read(new_ns := rig.now_ns())

    assert [(fresh_ns, 2.0), (fresh_ns, 2.0), (new_ns, 4.0)] == [
        (sample.t_ns, sample.position_um) for sample in (fresh, old, new)
    ]


def test_the_first_reading_of_a_d_drive_may_be_as_old_as_a_refresh() -> None:
    """The first reading of a d-Drive counts as 500 ms old."""
    rig = Rig("ddrive", "position")
    device = rig.started()

    (sample,) = device.read(now_ns := rig.now_ns())

    assert now_ns - 500 * MS == sample.t_ns


def test_an_nv40_1_is_read_after_every_setpoint() -> None:
    """A model without acknowledgement has accepted a setpoint when it replies afterwards."""
    rig = Rig("nv40-1")
    device = rig.started()
    rig.line.change = lambda _reply: b""

    assert not device.write([5.0], rig.now_ns())
    assert rig.line.sent == [b"wr,5.000\r", b"rd\r"]


@pytest.mark.sees("psj", "B6")
@pytest.mark.parametrize("stray", [b"\x13\r\n\x11", b"\x13meas,7.0\r\n\x11", b"\x13hello\r\n\x11"])
def test_an_answer_to_something_else_ends_no_waiting(stray: bytes) -> None:
    """Only the reply to `set` ends the wait for a late reply to `set`."""
    rig = Rig("nv200")
    device = rig.started()
    rig.line.change = lambda _reply: b""
    assert device.read_back(rig.now_ns()) != [0.0]
    rig.line.change = lambda reply: reply
    rig.line.comes(stray)

    assert not device.write([5.0], rig.now_ns())
    assert DeviceFlag.GARBAGE in rig.flags()
    rig.line.comes(b"\x13set,3.000\r\n\x11")
    assert device.read_back(rig.now_ns() + 1) == [0.0]


def test_a_stray_answer_in_time_is_not_taken() -> None:
    """A reply to another command is skipped, and the right one is found behind it."""
    rig = Rig("nv200")
    device = rig.started()
    rig.line.change = lambda reply: b"\x13meas,7.0\r\n\x11" + reply

    assert device.read_back(rig.now_ns()) == [0.0]
    assert device.write([5.0], rig.now_ns())
