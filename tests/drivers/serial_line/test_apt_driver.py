"""Drivers for Thorlabs cubes: their requests, and the cubes that they refuse."""

from collections.abc import Callable

import pytest

from piezod.devices.interface import Wiring
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import HOST, UNIT, DisplayMode, Id
from piezod_drivers.serial_line.thorlabs_apt.cube_line import wake_cube
from piezod_drivers.serial_line.thorlabs_apt.driver import PLUGIN
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from tests.drivers.serial_line.apt_bench import (
    NOW,
    answering,
    answering_words,
    instead,
    kpz,
    ksg,
    show,
)
from tests.drivers.serial_line.linear_rig import UM_PER_V


def test_amplifier_reports_its_identity_and_holds() -> None:
    """An amplifier reports model and serial number; its range is its limit, and it holds."""
    device, _, _, _ = kpz(max_v=150)
    assert device.open() == ("Thorlabs", "KPZ101", "29000001", "1.0.3")
    able = device.capabilities()
    assert able.outputs == ("1",)
    assert able.holds
    assert able.read_back
    device.close()


def test_voltage_goes_through_to_the_actuator() -> None:
    """A written voltage is at the actuator and is read back."""
    device, _, rig, _ = kpz()
    device.open()
    device.activate(NOW)
    assert device.write([42.0], NOW)
    assert rig.drive_v[0] == pytest.approx(42.0, abs=0.005)
    assert device.read_back(NOW) == pytest.approx([42.0], abs=0.005)


def test_output_that_is_off_is_enabled_from_zero() -> None:
    """A disabled output with a voltage set does not jump when it is enabled."""
    device, line, rig, emulator = kpz()
    device.open()
    emulator.receive(codec.long(Id.SET_OUTPUT, codec.words(1, 20_000)))
    device.activate(NOW)
    assert rig.drive_v == [0.0]
    sent = b"".join(line.sent)
    zero = codec.long(Id.SET_OUTPUT, codec.words(1, 0))
    assert 0 <= sent.index(zero) < sent.index(codec.short(Id.SET_ENABLED, 1, 1))


def test_output_that_is_on_stays() -> None:
    """Activating and deactivating leave an enabled output at its voltage."""
    device, _, rig, emulator = kpz()
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 1))
    emulator.receive(codec.long(Id.SET_OUTPUT, codec.words(1, 10_000)))
    before = list(rig.drive_v)
    device.open()
    device.activate(NOW)
    device.close()
    assert rig.drive_v == before != [0.0]


@pytest.mark.parametrize("mode", [2, 4])
def test_closed_loop_is_refused(mode: int) -> None:
    """Closed loop prevents activation with the remedy, and nothing is set."""
    device, line, rig, emulator = kpz()
    emulator.receive(codec.short(Id.SET_CONTROL_MODE, 1, mode))
    rig.drive_v[0] = 40.0
    device.open()
    line.sent.clear()
    with pytest.raises(DeviceError, match=r"in closed loop.*open the loop at rest"):
        device.activate(NOW)
    assert line.sent == [codec.short(Id.REQ_CONTROL_MODE, 1)]
    assert rig.drive_v == [40.0]


def test_knob_that_adds_nothing_is_switched_off() -> None:
    """An input that adds nothing is switched off; then only the host sets the voltage."""
    device, _, _, emulator = kpz()
    emulator.source = 2
    device.open()
    device.activate(NOW)
    assert emulator.source == 0


def test_knob_that_adds_a_voltage_is_reported() -> None:
    """An input that adds a voltage prevents activation, because switching it off is a jump."""
    device, _, rig, emulator = kpz()
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 1))
    emulator.source = 2
    rig.drive_v = [30.0]
    device.open()
    with pytest.raises(DeviceError, match=r"adds 30\.0 V, .* turn it to zero"):
        device.activate(NOW)
    assert rig.drive_v == [30.0]


def test_other_limit_is_refused() -> None:
    """An amplifier with another voltage limit than configured is refused."""
    device, _, _, _ = kpz(max_v=75)
    with pytest.raises(DeviceError, match="limited to 150 V, configured is max_v: 75"):
        device.open()


def test_other_model_is_refused() -> None:
    """A cube of another model than configured is refused."""
    device, _, _, _ = ksg(model="TSG001")
    with pytest.raises(DeviceError, match="leads to KSG101, configured is TSG001"):
        device.open()


def test_silent_port_is_reported() -> None:
    """A port without reply is an unavailable device."""
    device, line, _, _ = kpz()
    line.change = lambda _: b""
    with pytest.raises(DeviceUnavailableError, match="no reply within 500 ms"):
        device.open()


def test_reader_gives_displacement() -> None:
    """A reader gives its displacement in µm."""
    device, _, rig, _ = ksg()
    device.open()
    device.activate(NOW)
    rig.drive_v = [100.0]
    (sample,) = device.read(NOW)
    assert sample.valid
    assert sample.position_um == pytest.approx(100.0 * UM_PER_V, abs=0.001)


def test_scale_of_readings_can_be_set() -> None:
    """A configured displacement at full scale replaces the reported one."""
    device, _, rig, _ = ksg(full_scale_um=60.0)
    device.open()
    device.activate(NOW)
    rig.drive_v = [50.0]
    assert device.read(NOW)[0].position_um == pytest.approx(2 * 50.0 * UM_PER_V, abs=0.002)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (answering(Id.GET_ENABLED, 2), "does not enable its output"),
        (answering_words(Id.GET_SOURCE, 1, 2), "still obeys its knob or input"),
    ],
)
def test_amplifier_that_gives_no_control_is_refused(
    change: Callable[[bytes], bytes], what: str
) -> None:
    """An amplifier that refuses a step of the activation is refused with the remedy."""
    device, line, _, _ = kpz()
    device.open()
    line.change = change
    with pytest.raises(DeviceError, match=what):
        device.activate(NOW)


def test_unknown_limit_is_refused() -> None:
    """An amplifier with an unknown voltage limit is refused: its scale is unknown."""
    device, line, _, _ = kpz()
    answer = codec.long(Id.GET_IO, bytes((1, 0, 9, *[0] * 7)), to=HOST, source=UNIT)
    line.change = instead(Id.GET_IO, answer)
    with pytest.raises(DeviceError, match="unknown voltage limit: 9"):
        device.open()


def test_reader_without_travel_needs_a_scale() -> None:
    """A reader without a travel is refused unless the scale is configured."""
    device, line, _, _ = ksg()
    line.change = answering_words(Id.GET_MAX_TRAVEL, 1, 0)
    with pytest.raises(DeviceError, match="set full_scale_um"):
        device.open()


@pytest.mark.parametrize(
    ("mode", "shown"),
    [
        (DisplayMode.VOLTAGE, "a voltage"),
        (DisplayMode.FORCE, "a force"),
        (0, r"an unknown quantity \(0\)"),
    ],
)
def test_reader_that_shows_no_position_is_refused(mode: int, shown: str) -> None:
    """A reader whose readings are volts or newtons is refused with the remedy."""
    device, _, _, emulator = ksg()
    show(emulator, mode)
    with pytest.raises(DeviceError, match=f"shows {shown}: set its display to position"):
        device.open()


def test_port_lost_while_opening_is_reported() -> None:
    """A reader whose port is lost during opening is unavailable."""
    device, line, _, _ = ksg()

    def pull(reply: bytes) -> bytes:
        line.unplugged = codec.ident_of(reply) == Id.GET_MAX_TRAVEL
        return reply

    line.change = pull
    with pytest.raises(DeviceUnavailableError, match="is gone"):
        device.open()


def test_cube_is_woken_by_rts() -> None:
    """RTS goes on, pending bytes are dropped, RTS goes off, with 50 ms after each."""
    done: list[object] = []

    class Port:
        def reset_input_buffer(self) -> None:
            done.append("dropped")

        def __setattr__(self, name: str, value: object) -> None:
            done.append((name, value))

    wake_cube(Port(), done.append)  # type: ignore[arg-type]  # as much of a port as is used
    assert done == [("rts", True), 0.05, "dropped", ("rts", False), 0.05]


def test_plug_in_lists_the_channel_of_each_model() -> None:
    """An amplifier has one output in V, a reader one input in µm."""
    for model, inputs, outputs in (("TPZ001", {}, {"1": "V"}), ("TSG001", {"1": "µm"}, {})):
        options = AptOptions.model_validate({"port": "p", "model": model})
        assert PLUGIN.channels(options) == (inputs, outputs)
        assert PLUGIN.create(options, Wiring((), ()), 1) is not None
