"""Thorlabs cubes: what drivers say to them, and what they make of the answers."""

from math import isnan

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.amplifier import AmplifierDialogue
from piezod_drivers.serial_line.thorlabs_apt.codec import HOST, UNIT, Id
from piezod_drivers.serial_line.thorlabs_apt.driver import PLUGIN
from piezod_drivers.serial_line.thorlabs_apt.emulator import Amplifier, Reader
from piezod_drivers.serial_line.thorlabs_apt.options import Options
from piezod_drivers.serial_line.thorlabs_apt.reader import ReaderDialogue
from tests.drivers.serial_line.linear_rig import UM_PER_V, LinearRig, bench
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine

NOW = 5
OUTPUT, INPUT = Wiring((), ("1",)), Wiring(("1",), ())


def kpz(**options: object) -> tuple[BusDevice, EmulatedLine, LinearRig, Amplifier]:
    """Return an amplifier, the line to it, and what is behind the line."""
    stand, rig, time = bench()
    emulator = Amplifier(stand, "")
    line = EmulatedLine(emulator, time)
    told = Options.model_validate({"port": "p", "model": "KPZ101", **options})
    return BusDevice("KPZ101", AmplifierDialogue(told, OUTPUT, line)), line, rig, emulator


def ksg(
    request: int = Id.READING_7DE, **options: object
) -> tuple[BusDevice, EmulatedLine, LinearRig]:
    """Return a strain gauge reader, the line to it, and the rig behind it."""
    stand, rig, time = bench()
    line = EmulatedLine(Reader(stand, "", request), time)
    told = Options.model_validate({"port": "p", "model": "KSG101", **options})
    return BusDevice("KSG101", ReaderDialogue(told, INPUT, line)), line, rig


def test_amplifier_says_who_it_is_and_holds() -> None:
    """An amplifier tells model and serial number, its range follows its limit, and it holds."""
    device, _, _, _ = kpz(max_v=150)
    assert device.open() == ("Thorlabs", "KPZ101", "29000001", "1.0.3")
    able = device.capabilities()
    assert able.outputs == ("1",)
    assert able.holds
    assert able.read_back
    device.close()


def test_voltage_goes_through_to_the_actuator() -> None:
    """A voltage that is written is in force, at the actuator and as told."""
    device, _, rig, _ = kpz()
    device.open()
    device.activate(NOW)
    assert device.write([42.0], NOW)
    assert rig.drive_v[0] == pytest.approx(42.0, abs=0.005)
    assert device.read_back(NOW) == pytest.approx([42.0], abs=0.005)


def test_output_that_is_off_is_enabled_from_zero() -> None:
    """An output that is off, with a voltage set, does not jump when it is enabled."""
    device, line, rig, emulator = kpz()
    device.open()
    emulator.receive(codec.long(Id.SET_OUTPUT, codec.words(1, 20_000)))
    device.activate(NOW)
    assert rig.drive_v == [0.0]
    sent = b"".join(line.sent)
    zero = codec.long(Id.SET_OUTPUT, codec.words(1, 0))
    assert 0 <= sent.index(zero) < sent.index(codec.short(Id.SET_ENABLED, 1, 1))


def test_output_that_is_on_stays() -> None:
    """Taking control of an output that is on leaves its voltage, as does giving it back."""
    device, _, rig, emulator = kpz()
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 1))
    emulator.receive(codec.long(Id.SET_OUTPUT, codec.words(1, 10_000)))
    before = list(rig.drive_v)
    device.open()
    device.activate(NOW)
    device.close()
    assert rig.drive_v == before != [0.0]


def test_closed_loop_is_opened_smoothly() -> None:
    """Closed loop is left by the mode that does not jump."""
    device, line, _, emulator = kpz()
    emulator.receive(codec.short(Id.SET_CONTROL_MODE, 1, 2))
    device.open()
    device.activate(NOW)
    assert codec.short(Id.SET_CONTROL_MODE, 1, 3) in line.sent


def test_knob_that_adds_nothing_is_switched_off() -> None:
    """An input that adds nothing is switched off; the host alone sets the voltage then."""
    device, _, _, emulator = kpz()
    emulator.source = 2
    device.open()
    device.activate(NOW)
    assert emulator.source == 0


def test_knob_that_adds_a_voltage_is_told() -> None:
    """An input that adds a voltage is not switched off, which would jump: the user has to."""
    device, _, rig, emulator = kpz()
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 1))
    emulator.source = 2
    rig.drive_v = [30.0]
    device.open()
    with pytest.raises(DeviceError, match=r"adds 30\.0 V: turn it to zero"):
        device.activate(NOW)
    assert rig.drive_v == [30.0]


def test_other_limit_is_refused() -> None:
    """An amplifier that is set to another voltage limit than the configuration says is refused."""
    device, _, _, _ = kpz(max_v=75)
    with pytest.raises(DeviceError, match="limited to 150 V, the configuration says max_v: 75"):
        device.open()


def test_other_model_is_refused() -> None:
    """A cube of another model than the configuration says is refused."""
    device, _, _ = ksg(model="TSG001")
    with pytest.raises(DeviceError, match="leads to a KSG101, the configuration says TSG001"):
        device.open()


def test_silent_port_is_told() -> None:
    """A port at which nobody answers is an absent device."""
    device, line, _, _ = kpz()
    line.change = lambda _: b""
    with pytest.raises(DeviceUnavailableError, match="no reply within 500 ms"):
        device.open()


@pytest.mark.parametrize("request_id", [Id.READING_7DE, Id.READING_7DD])
def test_reader_gives_displacement_in_either_form(request_id: int) -> None:
    """A reader is understood in both forms that sources tell of, and gives µm."""
    device, _, rig = ksg(request_id)
    device.open()
    device.activate(NOW)
    rig.drive_v = [100.0]
    (sample,) = device.read(NOW)
    assert sample.valid
    assert sample.position_um == pytest.approx(100.0 * UM_PER_V, abs=0.001)


def test_scale_of_readings_can_be_set() -> None:
    """The displacement at full scale is the configuration's where it says so."""
    device, _, rig = ksg(full_scale_um=60.0)
    device.open()
    device.activate(NOW)
    rig.drive_v = [50.0]
    assert device.read(NOW)[0].position_um == pytest.approx(2 * 50.0 * UM_PER_V, abs=0.002)


@pytest.mark.sees("thorlabs_apt", "S7")
def test_end_of_range_is_told() -> None:
    """A reading at the end of the range is invalid, and said to be saturated."""
    device, _, rig = ksg()
    device.open()
    device.activate(NOW)
    rig.valid = False
    (sample,) = device.read(NOW)
    assert not sample.valid
    assert isnan(sample.position_um)
    assert set(device.status(NOW)[0]) == {DeviceFlag.SATURATED}


@pytest.mark.sees("thorlabs_apt", "A8")
def test_disabled_output_is_told() -> None:
    """An output that is switched off at the device is told by the next update."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    emulator.receive(codec.short(Id.SET_ENABLED, 1, 2))
    line.time.t_ns += 200 * MS
    device.read_back(NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE}


@pytest.mark.sees("thorlabs_apt", "A1")
@pytest.mark.sees("thorlabs_apt", "A8")
def test_voltage_that_is_not_set_is_refused() -> None:
    """A write is refused where the amplifier tells another voltage than was set."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.change = lambda _: codec.long(Id.GET_OUTPUT, codec.words(1, 77), to=HOST, source=UNIT)
    assert not device.write([50.0], NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.LOCAL_MODE}


@pytest.mark.sees("thorlabs_apt", "B10")
def test_complaint_is_told() -> None:
    """An error that the device reports by itself is told, and disturbs no exchange."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.comes(codec.short(Id.RESPONSE, to=HOST, source=UNIT))
    assert device.write([50.0], NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.DEVICE_FAILURE}


@pytest.mark.sees("thorlabs_apt", "B3")
@pytest.mark.parametrize("garbage", [b"\xff", b"\x45\x06\x04", b"?" * 300])
def test_garbage_before_an_answer_is_told(garbage: bytes) -> None:
    """Garbage before an answer is told, and the answer is found behind it."""
    device, line, _, _ = kpz()
    device.open()
    device.activate(NOW)
    line.change = lambda reply: garbage + reply
    assert device.write([50.0], NOW)
    assert set(device.status(NOW)[0]) == {DeviceFlag.GARBAGE}


def test_updates_are_never_taken_for_answers() -> None:
    """Updates that come with each answer, in front of it or behind it, change nothing."""
    device, line, rig, emulator = kpz()
    device.open()
    device.activate(NOW)
    (update,) = emulator.receive(codec.short(Id.REQ_STATUS, 1))
    for i in range(200):
        line.change = (lambda r: update + r) if i % 2 else (lambda r: r + update)
        assert device.write([float(i % 150)], NOW)
        assert device.read_back(NOW) == pytest.approx([i % 150], abs=0.01)
    assert not device.status(NOW)[0]
    assert codec.short(Id.ACK_STATUS) in b"".join(line.sent)
    assert rig.drive_v[0] == pytest.approx(199 % 150, abs=0.01)


def test_half_a_message_does_not_block_for_ever() -> None:
    """Half a message without the rest is garbage after a while, and is not glued to later ones."""
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


@pytest.mark.sees("thorlabs_apt", "B5")
@pytest.mark.sees("thorlabs_apt", "B6")
@pytest.mark.parametrize("cycles", [2000, pytest.param(50_000, marks=pytest.mark.stress)])
def test_late_answers_are_never_taken_for_the_next(cycles: int) -> None:
    """With answers up to ten time-outs late, or twice, no voltage of another instant is told."""
    device, line, _, emulator = kpz()
    device.open()
    device.activate(NOW)
    seen: set[DeviceFlag] = set()
    taken = 0
    for i in range(cycles):
        value = float(i * 7 % 150)
        line._delay_ns = (1 + i // 40 % 13 * 24) * MS if i % 40 == 0 else 1 * MS  # noqa: SLF001 - the test's own line
        line.change = (lambda r: r + r) if i % 17 == 0 else (lambda r: r)
        line.time.t_ns += 10 * MS
        if device.write([value], NOW):
            taken += 1
            assert (
                emulator.receive(codec.short(Id.REQ_OUTPUT, 1))[0][8:]
                == codec.words(1, round(value / 150 * codec.FULL_SCALE))[2:]
            )
        told = device.read_back(NOW)[0]
        held = codec.words_of(emulator.receive(codec.short(Id.REQ_OUTPUT, 1))[0], 1)[0]
        assert isnan(told) or told == pytest.approx(held / codec.FULL_SCALE * 150)
        seen |= device.status(NOW)[0]
    assert taken > cycles // 20
    assert {DeviceFlag.LATE_REPLY, DeviceFlag.OUT_OF_ORDER} <= seen


def test_plug_in_tells_the_channel_of_each_model() -> None:
    """An amplifier has one output in V, a reader one input in µm."""
    for model, inputs, outputs in (("TPZ001", {}, {"1": "V"}), ("TSG001", {"1": "µm"}, {})):
        options = Options.model_validate({"port": "p", "model": model})
        assert PLUGIN.channels(options) == (inputs, outputs)
        assert PLUGIN.create(options, Wiring((), ()), 1) is not None
