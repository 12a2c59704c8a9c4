"""Taking control of the outputs of a GCS 2 controller without a jump."""

import re

import pytest

from piezod.errors import DeviceError, DeviceUnavailableError
from tests.drivers.serial_line.pi_gcs2_bench import (
    LIMITS,
    NO_PLAY,
    OPENING,
    emulated,
    scripted,
)
from tests.drivers.serial_line.scripted_line import (
    ScriptedLine,
    exchange,
)


def test_activation_leaves_the_output() -> None:
    """An output that the servo drives keeps its voltage, in one write."""
    device, line, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].setpoint_v, emulator.axes[0].servo = 40.0, 0.0, True
    device.activate(0)
    assert rig.drive_v == [40.0]
    assert b"SVO 1 0\nSVA 1 40.0000\nERR?\n" in line.sent
    assert device.write([41.0], 1)


@pytest.mark.parametrize("in_force_v", [-20.5, 999.0])
def test_activation_never_clamps(in_force_v: float) -> None:
    """An output that the servo drives beyond the range is refused, and nothing is set."""
    device, line, emulator, rig = emulated()
    emulator.axes[0].servo = True
    monitored = f"1={in_force_v}".encode()
    rig.drive_v[0] = 40.0
    line.change = lambda reply: re.sub(rb"1=40\.0*", monitored, reply)
    with pytest.raises(DeviceError, match=r"axis 1 is at .* allowed range -20 to .* would jump"):
        device.activate(0)
    assert emulator.axes[0].servo
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]


def test_activation_needs_a_number() -> None:
    """An infinite voltage is refused, and nothing is set."""
    device, line, emulator, rig = emulated()
    emulator.axes[0].servo = True
    rig.drive_v[0] = 40.0
    line.change = lambda reply: re.sub(rb"1=40\.0*", b"1=1e400", reply)
    with pytest.raises(DeviceUnavailableError, match="not a voltage or position"):
        device.activate(0)
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]


def test_a_range_without_end() -> None:
    """An infinite limit is refused."""
    line = ScriptedLine(*OPENING, exchange(b"VMI? 1\nERR?\n", b"1=-1e999\n0\n"))
    with pytest.raises(DeviceError, match="reports an infinite range"):
        scripted(line).open()


def test_activation_takes_over_from_the_analog_input() -> None:
    """An offline channel is put online without leaving its voltage."""
    device, line, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].online = 40.0, False
    device.activate(0)
    assert emulator.axes[0].online
    assert rig.driven_v == [[40.0]]
    assert line.sent.index(b"SVA 1 40.0000\nERR?\n") < line.sent.index(b"ONL 1 1\nERR?\n")


def test_activation_takes_over_from_both_at_once() -> None:
    """An axis with servo and an offline axis both keep their voltages."""
    device, _, emulator, rig = emulated(2)
    emulator.receive(b"SVA 1 30 2 40\n")
    emulator.axes[0].servo, emulator.axes[1].online = True, False
    emulator.axes[0].setpoint_v = emulator.axes[1].setpoint_v = 0.0
    rig.driven_v.clear()
    device.activate(0)
    assert not emulator.axes[0].servo
    assert emulator.axes[1].online
    assert rig.driven_v == [[30.0, 40.0]] * 2


@pytest.mark.parametrize("servo", [False, True])
def test_an_analog_input_that_is_not_given_up(*, servo: bool) -> None:
    """A controller that refuses setpoints while its analog input drives is not changed."""
    device, line, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].online, emulator.axes[0].servo = 40.0, False, servo
    if not servo:
        line.change = lambda reply: b"72\n" if b"SVA 1" in line.sent[-1] else reply
    with pytest.raises(DeviceError, match=r"driven by its analog input and refuses .*at rest"):
        device.activate(0)
    assert (emulator.axes[0].online, emulator.axes[0].servo, rig.driven_v) == (False, servo, [])


def test_a_controller_that_fails_while_it_is_taken_over() -> None:
    """Another error is reported as it is, and the analog input continues to drive."""
    device, line, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].online = 40.0, False
    line.change = lambda reply: b"603\n" if b"SVA 1" in line.sent[-1] else reply
    with pytest.raises(DeviceUnavailableError, match="error 603: temperature too high"):
        device.activate(0)
    assert (emulator.axes[0].online, rig.driven_v) == (False, [])


@pytest.mark.parametrize("servo", [False, True])
def test_without_its_measured_voltage_an_output_is_not_taken_over(*, servo: bool) -> None:
    """With `SVA?` an output that servo or analog input drives is refused."""
    device, line, emulator, rig = emulated(read_back="SVA?")
    rig.drive_v[0], emulator.axes[0].servo, emulator.axes[0].online = 40.0, servo, servo
    with pytest.raises(DeviceError, match=r"axis 1 is driven .* SVA\? does not measure .* at rest"):
        device.activate(0)
    assert (emulator.axes[0].servo, rig.driven_v) == (servo, [])
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]
    emulator.axes[0].servo, emulator.axes[0].online = False, True
    device.activate(0)
    assert device.write([40.0], 1)


def test_a_setpoint_makes_earlier_readings_old() -> None:
    """After a setpoint the voltage is read again, even at the same instant."""
    device, _, _, _ = emulated()
    device.activate(0)
    device.read(7)
    before = device.read_back(7)
    assert device.write([2.5], 7)
    assert (before, device.read_back(7)) == ([0.0], [2.5])


def test_activation_that_changes_nothing_sends_nothing() -> None:
    """Nothing is sent for an output that `SVA` drives already."""
    device, line, _, _ = emulated()
    device.activate(0)
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]


def test_a_servo_that_stays_on() -> None:
    """A controller whose servo stays on is not activated."""
    on = exchange(b"SVO? 1\nERR?\n", b"1=1\n0\n"), exchange(b"ONL? 1\nERR?\n", b"2\n")
    line = ScriptedLine(*OPENING, *LIMITS, *NO_PLAY, *on, exchange(b"VOL? 1\nERR?\n", b"1=5\n0\n"))
    line.then(on[1], exchange(b"SVO 1 0\nSVA 1 5.0000\nERR?\n", b"0\n"), *on)
    device = scripted(line)
    device.open()
    with pytest.raises(DeviceError, match="the servo of axis 1 stays on"):
        device.activate(0)
