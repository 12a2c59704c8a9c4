"""Micro-Epsilon sensors: the use of the stream by the driver."""

from math import isnan

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.micro_epsilon.dialogue import MicroEpsilonDialogue
from piezod_drivers.serial_line.micro_epsilon.driver import PLUGIN
from piezod_drivers.serial_line.micro_epsilon.emulator import word_of
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES
from tests.drivers.serial_line.linear_rig import UM_PER_V
from tests.drivers.serial_line.micro_epsilon_bench import (
    ANSWER,
    AT_COUNT_UM,
    COUNT,
    GETINFO,
    WIRING,
    WORD,
    emulated,
    options,
    scripted,
)
from tests.drivers.serial_line.scripted_line import MS, T0_NS, US, ScriptedLine, exchange


@pytest.mark.parametrize(("model", "resolution_um"), [("ILD1420", 0.16), ("ODC2520", 1.0)])
def test_displacement_comes_through(model: str, resolution_um: float) -> None:
    """A sensor in front of an axis follows it, from the rest position on."""
    device, line, rig = emulated(model)
    assert device.open().model.startswith(model)
    device.activate(line.now_ns())
    line.time.t_ns += 2 * MS
    (rest,) = device.read(line.now_ns())
    rig.drive_v = [100.0]
    line.time.t_ns += 2 * MS
    (moved,) = device.read(line.now_ns())
    assert moved.valid
    assert moved.position_um - rest.position_um == pytest.approx(100 * UM_PER_V, abs=resolution_um)


def test_identity_is_found_between_values() -> None:
    """The identity is found between the values of the stream."""
    text = b"".join(ANSWER[i : i + 1] + WORD for i in range(len(ANSWER)))
    line = ScriptedLine(exchange(GETINFO, WORD[1:] + WORD + text + WORD))
    line.comes(WORD, 200 * US)
    device = BusDevice("ILD1420", MicroEpsilonDialogue(options(), WIRING, line))
    assert device.open() == ("Micro-Epsilon", "ILD1420-10", "77", "1")


def test_newest_value_wins() -> None:
    """Of many pending values the last one is read, with the instant of the call."""
    device, line = scripted()
    line.comes(b"".join(word_of(COUNT + i, 3) for i in range(500)))
    now_ns = line.now_ns()
    (sample,) = device.read(now_ns)
    assert sample.t_ns == now_ns
    assert sample.position_um == pytest.approx(AT_COUNT_UM + 499 * 1.02 / 65520 * 10_000)


@pytest.mark.sees("micro_epsilon", "S6")
def test_value_that_is_not_new_keeps_its_instant() -> None:
    """While no other value comes, the last one keeps its instant."""
    device, line = scripted()
    line.comes(WORD)
    (first,) = device.read(T0_NS + 5 * MS)
    assert device.read(T0_NS + 6 * MS) == [first]
    line.comes(WORD[:2])
    assert device.read(T0_NS + 7 * MS) == [first]
    line.comes(WORD[2:])
    assert device.read(T0_NS + 8 * MS) == [first._replace(t_ns=T0_NS + 8 * MS)]


@pytest.mark.sees("micro_epsilon", "S5")
@pytest.mark.sees("micro_epsilon", "B5")
def test_silence_is_reported() -> None:
    """A stream that stops is reported after a time-out, and its last value becomes invalid."""
    device, line = scripted()
    line.comes(WORD)
    device.read(T0_NS)
    assert not device.status(T0_NS)[0]
    (sample,) = device.read(T0_NS + 31 * MS)
    assert sample.t_ns == T0_NS
    assert not sample.valid
    assert set(device.status(T0_NS)[0]) == {DeviceFlag.LATE_REPLY}


def test_activating_waits_for_a_value() -> None:
    """Activating discards pending values and waits for a new one."""
    device, line = scripted()
    device.deactivate(line.now_ns())
    line.comes(word_of(COUNT + 5, 3))
    line.comes(WORD, 5 * MS)
    device.activate(line.now_ns())
    assert device.read(line.now_ns())[0].position_um == pytest.approx(AT_COUNT_UM)


def test_before_the_first_value_nothing_is_valid() -> None:
    """Without a value since activation there is no valid sample."""
    device, _ = scripted()
    (sample,) = device.read(T0_NS + MS)
    assert not sample.valid
    assert isnan(sample.position_um)


@pytest.mark.sees("micro_epsilon", "S7")
@pytest.mark.sees("micro_epsilon", "S8")
@pytest.mark.parametrize(
    ("model", "count", "flags"),
    [
        ("ILD1420", 642, {DeviceFlag.SATURATED}),
        ("ILD1420", 643, set()),
        ("ILD1420", 64_877, set()),
        ("ILD1420", 64_878, {DeviceFlag.SATURATED}),
        ("ILD1420", 262_076, {DeviceFlag.LOW_LIGHT}),
        ("ILD1420", 262_078, {DeviceFlag.SATURATED}),
        ("ILD1900", 230_604, set()),
        ("ILD1900", 230_605, {DeviceFlag.SATURATED}),
        ("ODC2520", 262_071, set()),
        ("ILD1402", 16_207, set()),
        ("ILD1402", 16_374, {DeviceFlag.SATURATED}),
    ],
)
def test_limits_and_codes(model: str, count: int, flags: set[DeviceFlag]) -> None:
    """A count beyond the range, or an error code, is no displacement and sets its flag."""
    device, line = scripted(model, range_mm=10.0)
    line.comes(word_of(count, PROFILES[model].word_bytes))
    (sample,) = device.read(T0_NS + MS)
    assert sample.valid == (not flags)
    assert set(device.status(T0_NS + MS)[0]) == flags


@pytest.mark.sees("micro_epsilon", "B3")
@pytest.mark.parametrize(("model", "word_bytes"), [("ILD1420", 3), ("ILD1402", 2)])
def test_flipped_flags_make_no_value(model: str, word_bytes: int) -> None:
    """A word with a flipped flag is never read as another value; one such flip is silent."""
    counts = [8000, 8001, 8002]
    sent = b"".join(word_of(count, word_bytes) for count in counts)
    flags = {3: (7, 6, 15, 14, 23, 22), 2: (7, 15)}[word_bytes]
    unsaid = []
    for bit in (8 * word_bytes + flag for flag in flags):
        changed = bytearray(sent)
        changed[bit // 8] ^= 1 << bit % 8
        device, line = scripted(model, range_mm=10.0)
        line.comes(word_of(7999, word_bytes))
        device.read(T0_NS)
        seen = set()
        for i in range(len(changed)):
            line.comes(bytes(changed[i : i + 1]))
            seen.add(device.read(T0_NS + i)[0].position_um)
        allowed = {PROFILES[model].read(count, 10_000.0)[0] for count in (7999, 8000, 8002)}
        assert seen <= allowed
        if DeviceFlag.GARBAGE not in device.status(T0_NS)[0]:
            unsaid.append(bit - 8 * word_bytes)
    assert unsaid == ([22] if word_bytes == 3 else [])


@pytest.mark.sees("micro_epsilon", "B11")
def test_backlog_is_dropped_and_reported() -> None:
    """A full buffer is reported, and the newest value is read."""
    device, line = scripted()
    line.comes(WORD * 1364 + word_of(COUNT + 1, 3))
    (sample,) = device.read(T0_NS)
    assert sample.position_um > AT_COUNT_UM
    assert set(device.status(T0_NS)[0]) == {DeviceFlag.BUS_OVERLOADED}


def test_lost_axis_is_beyond_the_range() -> None:
    """An emulated sensor without a target sends an error code."""
    device, line, rig = emulated()
    device.open()
    rig.valid = False
    device.activate(line.now_ns())
    line.time.t_ns += 2 * MS
    assert not device.read(line.now_ns())[0].valid
    assert set(device.status(line.now_ns())[0]) == {DeviceFlag.SATURATED}
    rig.valid, rig.drive_v = True, [1e6]
    line.time.t_ns += 2 * MS
    assert not device.read(line.now_ns())[0].valid


def test_silent_sensor_is_reported_with_a_remedy() -> None:
    """A sensor that replies but sends no values is refused with the remedy."""
    line = ScriptedLine(exchange(GETINFO, ANSWER))
    device = BusDevice("ILD1420", MicroEpsilonDialogue(options(), WIRING, line))
    with pytest.raises(DeviceUnavailableError, match="set the sensor to output over RS-422"):
        device.open()


def test_other_model_is_refused() -> None:
    """A sensor of another family than configured is refused."""
    line = ScriptedLine(exchange(GETINFO, ANSWER))
    device = BusDevice("ILD1900", MicroEpsilonDialogue(options("ILD1900"), WIRING, line))
    with pytest.raises(DeviceError, match="leads to ILD1420-10, configured is ILD1900"):
        device.open()


def test_range_has_to_be_known() -> None:
    """A sensor that does not report its range needs a configured one."""
    device = BusDevice("ILD1402", MicroEpsilonDialogue(options("ILD1402"), WIRING, ScriptedLine()))
    with pytest.raises(DeviceError, match="set range_mm"):
        device.open()


def test_bit_rate_is_the_profiles_unless_set() -> None:
    """The bit rate is that of the family unless it is configured."""
    assert options("ODC2520").bits_per_s == 115_200
    assert options("ILD1420").bits_per_s == 921_600
    assert options("ODC2520", baud=921_600).bits_per_s == 921_600
    assert PLUGIN.channels(options()) == ({"distance": "µm"}, {})
    assert PLUGIN.create(options(), WIRING, 1) is not None
