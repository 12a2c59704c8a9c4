"""Micro-Epsilon sensors: the stream, who they are, and what the driver makes of both."""

from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.micro_epsilon import stream
from piezod_drivers.serial_line.micro_epsilon.dialogue import StreamDialogue
from piezod_drivers.serial_line.micro_epsilon.driver import PLUGIN
from piezod_drivers.serial_line.micro_epsilon.emulator import ILD1420, ODC2520, Sensor
from piezod_drivers.serial_line.micro_epsilon.info import info_of
from piezod_drivers.serial_line.micro_epsilon.options import Options
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES
from tests.drivers.serial_line.linear_rig import UM_PER_V, LinearRig, bench
from tests.drivers.serial_line.scripted_line import MS, T0_NS, US, EmulatedLine, ScriptedLine, says

WIRING = Wiring(("distance",), ())
GETINFO = b"GETINFO\n"
ANSWER = (
    b"GETINFO\r\nName: ILD1420-10\r\nSerial: 77\r\nMeasuring range: 10.00mm\r\nVersion: 1\r\n->"
)
COUNT = 32_000
WORD = stream.pack(COUNT, 3)
AT_COUNT_UM = (COUNT * 102 / 65520 - 1) / 100 * 10_000


def options(model: str = "ILD1420", **more: object) -> Options:
    """Return the options of a sensor."""
    return Options.model_validate({"port": "p", "model": model, **more})


def emulated(model: str = "ILD1420") -> tuple[BusDevice, EmulatedLine, LinearRig]:
    """Return a sensor, the line to it, and the rig in front of it."""
    stand, rig, time = bench()
    plugin = ILD1420 if model == "ILD1420" else ODC2520
    assert plugin.create is not None
    line = EmulatedLine(plugin.create(stand, ""), time)
    return BusDevice(model, StreamDialogue(options(model), WIRING, line)), line, rig


def scripted(model: str = "ILD1420", **more: object) -> tuple[BusDevice, ScriptedLine]:
    """Return an active sensor that sends what the test says."""
    line = ScriptedLine()
    if PROFILES[model].talks:
        line.then(says(GETINFO, WORD + ANSWER.replace(b"ILD1420", model.encode()) + WORD))
    device = BusDevice(model, StreamDialogue(options(model, **more), WIRING, line))
    line.comes(stream.pack(COUNT >> 4, PROFILES[model].word_bytes), 200 * US)
    device.open()
    device.activate(line.now_ns())
    return device, line


@pytest.mark.parametrize(("model", "resolution_um"), [("ILD1420", 0.16), ("ODC2520", 1.0)])
def test_displacement_comes_through(model: str, resolution_um: float) -> None:
    """A sensor in front of an axis follows it, from its place at rest on."""
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
    """Who the sensor is comes out of the stream, in the middle of values."""
    text = b"".join(ANSWER[i : i + 1] + WORD for i in range(len(ANSWER)))
    line = ScriptedLine(says(GETINFO, WORD[1:] + WORD + text + WORD))
    line.comes(WORD, 200 * US)
    device = BusDevice("ILD1420", StreamDialogue(options(), WIRING, line))
    assert device.open() == ("Micro-Epsilon", "ILD1420-10", "77", "1")


def test_newest_value_wins() -> None:
    """Of many values that have come the last one is told, at the instant of the call."""
    device, line = scripted()
    line.comes(b"".join(stream.pack(COUNT + i, 3) for i in range(500)))
    now_ns = line.now_ns()
    (sample,) = device.read(now_ns)
    assert sample.t_ns == now_ns
    assert sample.position_um == pytest.approx(AT_COUNT_UM + 499 * 1.02 / 65520 * 10_000)


@pytest.mark.sees("micro_epsilon", "S6")
def test_value_that_is_not_new_keeps_its_instant() -> None:
    """As long as no other value comes, the last one is told with the instant it came."""
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
def test_silence_is_told() -> None:
    """A stream that ends is told after a time-out, and its last value gets old."""
    device, line = scripted()
    line.comes(WORD)
    device.read(T0_NS)
    assert not device.status(T0_NS)[0]
    (sample,) = device.read(T0_NS + 31 * MS)
    assert sample.t_ns == T0_NS
    assert not sample.valid
    assert set(device.status(T0_NS)[0]) == {DeviceFlag.LATE_REPLY}


def test_activating_waits_for_a_value() -> None:
    """What came before is forgotten; the first reading is of a value that came afterwards."""
    device, line = scripted()
    device.deactivate(line.now_ns())
    line.comes(stream.pack(COUNT + 5, 3))
    line.comes(WORD, 5 * MS)
    device.activate(line.now_ns())
    assert device.read(line.now_ns())[0].position_um == pytest.approx(AT_COUNT_UM)


def test_before_the_first_value_nothing_is_valid() -> None:
    """A sensor that has sent nothing since it was activated has no valid sample."""
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
    """A count beyond the range, or an error code, is no displacement and says why."""
    device, line = scripted(model, range_mm=10.0)
    line.comes(stream.pack(count, PROFILES[model].word_bytes))
    (sample,) = device.read(T0_NS + MS)
    assert sample.valid == (not flags)
    assert set(device.status(T0_NS + MS)[0]) == flags


@pytest.mark.parametrize(
    ("model", "count", "position_um"),
    [
        ("ILD1420", 32_760, 5_000.0),
        ("ILD1900", 98_232, 0.0),
        ("ILD1750", 98_232 + 65_536, 10_000.0),
        ("ODC2520", 131_026, 26.0),
        ("ILD1402", 8_184, 5_000.0),
    ],
)
def test_scales(model: str, count: int, position_um: float) -> None:
    """Counts are what the manuals' formulas make of them, for a range of 10 mm."""
    assert PROFILES[model].read(count, 10_000.0)[0] == pytest.approx(position_um, abs=1e-6)
    assert PROFILES[model].count_at(position_um, 10_000.0) == count


@given(
    st.sampled_from(sorted(PROFILES)),
    st.floats(-1e5, 1e5) | st.just(nan),
)
def test_any_count_is_read_within_range_or_refused(model: str, number: float) -> None:
    """Whatever count comes, the displacement is within the range and a half, or NaN."""
    profile = PROFILES[model]
    count = 0 if isnan(number) else int(abs(number)) % (1 << 18 if profile.word_bytes == 3 else 14)
    position_um, flags = profile.read(count, 10_000.0)
    if not isnan(position_um):
        assert not flags
        assert -131_000 <= position_um <= 131_072


@given(st.binary(max_size=400), st.sampled_from([2, 3]))
def test_arbitrary_bytes_are_a_stream(garbage: bytes, word_bytes: int) -> None:
    """Whatever comes, it is read without an error, and less than a word is kept."""
    value, rest, _ = stream.newest(garbage, word_bytes)
    assert len(rest) < word_bytes
    assert value is None or 0 <= value < 1 << 6 * word_bytes + (2 if word_bytes == 2 else 0)
    info_of(stream.text_of(garbage, word_bytes))


@given(
    st.lists(st.integers(0, 262_143), min_size=1, max_size=60),
    st.lists(st.integers(1, 40), min_size=1, max_size=60),
)
def test_parts_of_a_stream_give_what_the_whole_gives(counts: list[int], cuts: list[int]) -> None:
    """However a stream is cut, its last value is found and nothing is said to be broken."""
    whole, place, rest = b"".join(stream.pack(count, 3) for count in counts), 0, b""
    last = None
    for cut in cuts * len(whole):
        part = whole[place : place + cut]
        place += cut
        value, rest, broken = stream.newest(rest + part, 3)
        assert not broken
        last = last if value is None else value
        if place >= len(whole):
            break
    assert last == counts[-1]


def test_additional_values_are_passed_over() -> None:
    """Values that are sent beside the distance are not taken for it."""
    both = stream.pack(5, 3) + stream.pack(9, 3, additional=True)
    assert stream.newest(both * 3, 3) == (5, b"", False)


@pytest.mark.sees("micro_epsilon", "B3")
@pytest.mark.parametrize(("model", "word_bytes"), [("ILD1420", 3), ("ILD1402", 2)])
def test_flipped_flags_make_no_value(model: str, word_bytes: int) -> None:
    """A word with a flipped flag is never read as another value; all but one such flip is told."""
    counts = [8000, 8001, 8002]
    sent = b"".join(stream.pack(count, word_bytes) for count in counts)
    flags = {3: (7, 6, 15, 14, 23, 22), 2: (7, 15)}[word_bytes]
    unsaid = []
    for bit in (8 * word_bytes + flag for flag in flags):
        changed = bytearray(sent)
        changed[bit // 8] ^= 1 << bit % 8
        device, line = scripted(model, range_mm=10.0)
        line.comes(stream.pack(7999, word_bytes))
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
def test_backlog_is_dropped_and_told() -> None:
    """As much as the port's buffer holds was not read in time: it is told, and the newest taken."""
    device, line = scripted()
    line.comes(WORD * 1364 + stream.pack(COUNT + 1, 3))
    (sample,) = device.read(T0_NS)
    assert sample.position_um > AT_COUNT_UM
    assert set(device.status(T0_NS)[0]) == {DeviceFlag.BUS_OVERLOADED}


def test_silent_sensor_is_told_with_a_remedy() -> None:
    """A sensor that answers and sends no values is refused, with what to do."""
    line = ScriptedLine(says(GETINFO, ANSWER))
    device = BusDevice("ILD1420", StreamDialogue(options(), WIRING, line))
    with pytest.raises(DeviceUnavailableError, match="have the sensor output them at RS422"):
        device.open()


def test_other_model_is_refused() -> None:
    """A sensor of another family than the configuration says is refused."""
    line = ScriptedLine(says(GETINFO, ANSWER))
    device = BusDevice("ILD1900", StreamDialogue(options("ILD1900"), WIRING, line))
    with pytest.raises(DeviceError, match="leads to a ILD1420-10, the configuration says ILD1900"):
        device.open()


def test_range_has_to_be_known() -> None:
    """A sensor that cannot be asked for its range has to have it set."""
    device = BusDevice("ILD1402", StreamDialogue(options("ILD1402"), WIRING, ScriptedLine()))
    with pytest.raises(DeviceError, match="set range_mm"):
        device.open()


def test_bit_rate_is_the_profiles_unless_set() -> None:
    """The bit rate is as delivered for each family, unless the configuration says another."""
    assert options("ODC2520").bits_per_s == 115_200
    assert options("ILD1420").bits_per_s == 921_600
    assert options("ODC2520", baud=921_600).bits_per_s == 921_600
    assert PLUGIN.channels(options()) == ({"distance": "µm"}, {})
    assert PLUGIN.create(options(), WIRING, 1) is not None


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_emulator_survives_whatever_comes(parts: list[bytes]) -> None:
    """An emulator answers arbitrary bytes, or not, and raises nothing."""
    stand, _, time = bench()
    sensor = Sensor(stand, "", "ILD1420", "ILD1420-10", 10.0, 5000.0)
    for part in parts:
        sensor.receive(part)
        time.t_ns += MS
        assert len(sensor.due()) == 1 + (time.t_ns == T0_NS + MS)
