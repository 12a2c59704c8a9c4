"""Drivers for Thorlabs cubes with faults of the line and of the device."""

from math import isnan

import pytest

from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import HOST, UNIT, DisplayMode, Id
from piezod_drivers.serial_line.thorlabs_apt.emulator import KpzEmulator
from tests.drivers.serial_line.apt_bench import (
    NOW,
    answering_words,
    instead,
    kpz,
    ksg,
    show,
)
from tests.drivers.serial_line.linear_rig import UM_PER_V
from tests.drivers.serial_line.scripted_line import MS


@pytest.mark.sees("thorlabs_apt", "S7")
def test_end_of_range_is_reported() -> None:
    """A reading at the end of the range is invalid and reported as saturated."""
    device, _, rig, _ = ksg()
    device.open()
    device.activate(NOW)
    rig.valid = False
    (sample,) = device.read(NOW)
    assert not sample.valid
    assert isnan(sample.position_um)
    assert set(device.status(NOW)[0]) == {DeviceFlag.SATURATED}


@pytest.mark.sees("thorlabs_apt", "A8")
def test_disabled_output_is_reported() -> None:
    """An output that is switched off at the device is reported with the next status."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 2))
    line.time.t_ns += 200 * MS
    device.read_back(NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE}


@pytest.mark.sees("thorlabs_apt", "A8")
def test_disabled_output_is_reported_after_many_statuses() -> None:
    """After more statuses than a cube sends to a host that is gone, a disabled output is seen."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    for _ in range(200):
        line.time.t_ns += 100 * MS
        device.read_back(NOW)
    assert not device.status(NOW)[0]
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 2))
    line.time.t_ns += 200 * MS
    device.read_back(NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE}


def test_disabled_output_stays_reported_if_the_status_stops() -> None:
    """An output that was disabled still counts as disabled when no status comes any more."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 2))
    for _ in range(15):
        line.time.t_ns += 100 * MS
        device.read_back(NOW)
        line.change = lambda reply: b"" if codec.ident_of(reply) == Id.GET_STATUS else reply
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE, DeviceFlag.LATE_REPLY}


def test_cube_that_a_program_left_silent_is_opened() -> None:
    """A cube that has stopped its statuses for a program before us sends them to us."""
    device, _, _, emulator = kpz()
    while emulator.receive(codec.short(Id.REQ_STATUS, 1)):
        pass
    device.open()
    device.activate(NOW)
    assert not device.status(NOW)[0]


@pytest.mark.sees("thorlabs_apt", "B5")
def test_status_that_stops_is_reported() -> None:
    """A status of more than a second ago says nothing about the output; this is reported."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.change = lambda reply: b"" if codec.ident_of(reply) == Id.GET_STATUS else reply
    for _ in range(10):
        line.time.t_ns += 100 * MS
        device.read_back(NOW)
    assert not device.status(NOW)[0]
    line.time.t_ns += 100 * MS
    device.read_back(NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.LATE_REPLY}
    line.change = lambda reply: reply
    line.time.t_ns += 100 * MS
    device.read_back(NOW)
    assert not device.status(NOW)[0]


@pytest.mark.sees("thorlabs_apt", "B10")
@pytest.mark.parametrize("mode", [DisplayMode.VOLTAGE, DisplayMode.FORCE])
def test_reader_that_is_switched_to_another_quantity_gives_no_positions(mode: DisplayMode) -> None:
    """Readings of a reader that is switched to volts or newtons are invalid until it is back."""
    device, line, rig, emulator = ksg()
    device.open()
    device.activate(NOW)
    rig.drive_v = [100.0]
    assert device.read(NOW)[0].valid
    show(emulator, mode)
    line.time.t_ns += 100 * MS
    assert not device.read(NOW)[0].valid
    assert set(device.status(NOW)[0]) == {DeviceFlag.WRONG_REQUEST}
    show(emulator, DisplayMode.POSITION)
    line.time.t_ns += 100 * MS
    assert device.read(NOW)[0].position_um == pytest.approx(100.0 * UM_PER_V, abs=0.001)
    assert not device.status(NOW)[0]


@pytest.mark.sees("thorlabs_apt", "B5")
def test_reader_that_hides_its_mode_gives_no_positions() -> None:
    """Without the display mode for more than a second, readings are invalid."""
    device, line, _, _ = ksg()
    device.open()
    device.activate(NOW)
    line.change = lambda reply: b"" if codec.ident_of(reply) == Id.GET_GAUGE_IO else reply
    for _ in range(10):
        assert device.read(NOW)[0].valid
        line.time.t_ns += 100 * MS
    assert not device.read(NOW)[0].valid
    assert set(device.status(NOW)[0]) == {DeviceFlag.LATE_REPLY}


def _switch_off_and_on(emulator: KpzEmulator) -> None:
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 2))
    emulator.receive(codec.long(Id.SET_OUTPUT, codec.words(1, 0)))


@pytest.mark.sees("thorlabs_apt", "A7")
def test_amplifier_that_was_off_is_reported() -> None:
    """An amplifier that has lost its voltage is reported as restarted, once."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    assert device.write([50.0], NOW)
    _switch_off_and_on(emulator)
    line.time.t_ns += 200 * MS
    assert isnan(device.read_back(NOW)[0])
    assert set(device.status(NOW)[0]) == {DeviceFlag.RESTARTED, DeviceFlag.LOCAL_MODE}
    assert device.read_back(NOW) == [0.0]
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE}


@pytest.mark.sees("thorlabs_apt", "A7")
def test_amplifier_that_was_off_takes_no_voltage_unnoticed() -> None:
    """After a time-out nothing is set before the voltage in force was read."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    assert device.write([50.0], NOW)
    line.change = lambda _: b""
    assert not device.write([51.0], NOW)
    _switch_off_and_on(emulator)
    line.change = lambda reply: reply
    line.time.t_ns += 400 * MS
    assert not device.write([52.0], NOW)
    assert DeviceFlag.RESTARTED in device.status(NOW)[0]
    assert device.read_back(NOW) == [0.0]


def test_unacknowledged_zero_is_no_restart() -> None:
    """A voltage of 0 after an unconfirmed setpoint of 0 is no restart."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    assert device.write([50.0], NOW)
    line.change = lambda _: b""
    assert not device.write([0.0], NOW)
    line.change = lambda reply: reply
    line.time.t_ns += 400 * MS
    assert device.read_back(NOW) == [0.0]
    assert DeviceFlag.RESTARTED not in device.status(NOW)[0]


@pytest.mark.sees("thorlabs_apt", "A1")
@pytest.mark.sees("thorlabs_apt", "A8")
def test_voltage_that_is_not_set_is_refused() -> None:
    """A write fails if the amplifier reads back another voltage."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.change = lambda _: codec.long(Id.GET_OUTPUT, codec.words(1, 77), to=HOST, source=UNIT)
    assert not device.write([50.0], NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE}


@pytest.mark.sees("thorlabs_apt", "B10")
def test_error_of_the_cube_is_reported() -> None:
    """An error message of the device is reported and disturbs no exchange."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.comes(codec.short(Id.RESPONSE, to=HOST, source=UNIT))
    assert device.write([50.0], NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.DEVICE_FAILURE}


@pytest.mark.sees("thorlabs_apt", "B3")
@pytest.mark.parametrize("garbage", [b"\xff", b"\x45\x06\x04", b"?" * 300])
def test_garbage_before_an_answer_is_reported(garbage: bytes) -> None:
    """Garbage before a reply is reported, and the reply is found behind it."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.change = lambda reply: garbage + reply
    assert device.write([50.0], NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.GARBAGE}


def test_updates_are_never_taken_for_answers() -> None:
    """Statuses before or behind a reply are never taken for it."""
    device, line, rig, emulator = kpz()
    device.open()
    device.activate(NOW)
    (update,) = emulator.receive(codec.short(Id.REQ_STATUS, 1))
    for i in range(200):
        line.change = (lambda r: update + r) if i % 2 else (lambda r: r + update)
        assert device.write([float(i % 150)], NOW)
        assert device.read_back(NOW) == pytest.approx([i % 150], abs=0.01)
    assert not device.status(NOW)[0]
    assert rig.drive_v[0] == pytest.approx(199 % 150, abs=0.01)


def test_half_a_message_does_not_block_for_ever() -> None:
    """Half a message becomes garbage after a while and does not join later ones."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.change = lambda reply: reply[:-1]
    assert not device.write([50.0], NOW)
    line.change = lambda reply: reply
    line.time.t_ns += 400 * MS
    assert device.write([60.0], NOW)
    assert device.read_back(NOW) == pytest.approx([60.0], abs=0.01)
    assert DeviceFlag.GARBAGE in device.status(NOW)[0]


def test_answer_of_another_channel_is_garbage() -> None:
    """A reading of another channel is refused."""
    device, line, _, _ = ksg()
    device.open()
    device.activate(NOW)
    line.change = answering_words(Id.GET_READING, 2, 100, 100)
    assert not device.read(NOW)[0].valid
    assert set(device.status(NOW)[0]) == {DeviceFlag.GARBAGE}


def test_enabled_state_of_another_channel_is_garbage() -> None:
    """The enabled state of another channel is refused."""
    device, line, _, _ = kpz()
    device.open()
    other = codec.short(Id.GET_ENABLED, 2, 1, to=HOST, source=UNIT)
    line.change = instead(Id.GET_ENABLED, other)
    with pytest.raises(DeviceUnavailableError, match="channel 2 instead of 1"):
        device.activate(NOW)
