"""A converter card: set-points, faults, plays."""

import errno

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Table
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError, PortHeldError
from piezod.testing.driver_contract import checks_for
from piezod_drivers.kernel.comedi import play_arrays
from piezod_drivers.kernel.comedi.driver import PLUGIN, make_device
from piezod_drivers.kernel.comedi.options import ComediOptions
from piezod_drivers.kernel.comedi.play_stream import InStream, OutStream
from tests.drivers.kernel.fake_card import CONVERTER, MOST, OPTIONS, STEP_V, FakeCard

WIRING = Wiring(("position",), ("drive",))
WITH_LINES = Wiring(("position", "camera"), ("drive", "pixel", "frame"))


def opened(card: FakeCard, wiring: Wiring = WIRING) -> PlayingBusDevice:
    """Return a device on a card, open and active."""
    device = make_device(OPTIONS, wiring, card)
    assert isinstance(device, PlayingBusDevice)
    device.open()
    device.activate(card.now_ns)
    return device


def ramp(n: int, interval_ns: int = 100_000, cycles: int = 1) -> Table:
    """Return a table without a lead-in that rises."""
    return Table(interval_ns, np.zeros((0, 1)), np.linspace(0.0, 5.0, n)[:, None], cycles)


@pytest.mark.parametrize("wiring", [WIRING, WITH_LINES, Wiring(("camera",), ("pixel",))])
def test_driver_keeps_the_contract(wiring: Wiring, subtests: pytest.Subtests) -> None:
    """It passes every check of its roles."""
    for check in checks_for(lambda: make_device(OPTIONS, wiring, FakeCard())):
        with subtests.test(check.__name__):
            check(lambda: make_device(OPTIONS, wiring, FakeCard()))


@given(st.floats(-10.0, 10.0))
def test_code_is_the_nearest_one(value_v: float) -> None:
    """A voltage and that of its code differ by half a step; one value and arrays agree."""
    code = CONVERTER.code(value_v)
    assert abs(CONVERTER.value(code) - value_v) <= 0.5001 * STEP_V
    assert play_arrays.codes_of(np.array([[value_v]]), [CONVERTER])[0, 0] == code


@pytest.mark.sees("comedi", "S7")
@pytest.mark.parametrize("code", [0, MOST])
def test_sample_at_an_end_is_saturated(code: int) -> None:
    """It is not valid, and the status says why; in a record it is NaN."""
    card = FakeCard()
    device = opened(card)
    card.codes[0] = code
    (sample,) = device.read(card.now_ns)
    flags = device.status(card.now_ns)
    assert not sample.valid
    assert flags == [frozenset({DeviceFlag.SATURATED}), frozenset()]
    assert np.isnan(play_arrays.samples_of(code.to_bytes(2, "little"), [CONVERTER], 2)).all()


@pytest.mark.sees("comedi", "A1")
@pytest.mark.sees("comedi", "B1")
@pytest.mark.sees("comedi", "B10")
@pytest.mark.sees("comedi", "B14")
@pytest.mark.parametrize(
    ("number", "flag"),
    [
        (errno.ENODEV, DeviceFlag.DISCONNECTED),
        (errno.EBUSY, DeviceFlag.BUSY),
        (errno.EACCES, DeviceFlag.PORT_SHARED),
        (errno.EINVAL, DeviceFlag.WRONG_REQUEST),
        (errno.EIO, DeviceFlag.DEVICE_FAILURE),
        (errno.ETIMEDOUT, DeviceFlag.LATE_REPLY),
    ],
)
def test_error_of_the_kernel_is_a_value(number: int, flag: DeviceFlag) -> None:
    """Samples are invalid, writes are refused, the read-back is unknown; the status says why."""
    card = FakeCard()
    device = opened(card)
    card.refuses = number
    (sample,) = device.read(card.now_ns)
    accepted = device.write([1.0], card.now_ns)
    (read_back_v,) = device.read_back(card.now_ns)
    assert (sample.valid, accepted) == (False, False)
    assert np.isnan(read_back_v)
    assert all(flag in each for each in device.status(card.now_ns))
    assert card.written == []


@pytest.mark.sees("comedi", "A3")
@pytest.mark.sees("comedi", "A12")
def test_read_back_is_measured() -> None:
    """What another source does to the output is seen by the input that is wired to it."""
    card = FakeCard()
    device = opened(card)
    device.write([1.0], card.now_ns)
    card.codes[0] = CONVERTER.code(-9.0)
    assert device.read_back(card.now_ns + 1)[0] == pytest.approx(-9.0, abs=STEP_V)


@pytest.mark.sees("comedi", "S10")
def test_other_card_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """If another card is found when it is opened again, each channel says so."""
    card = FakeCard()
    device = opened(card)
    device.close()
    monkeypatch.setattr(FakeCard, "open", lambda _: ("fake", "other card", "0.7.76"))
    device.open()
    assert all(DeviceFlag.OTHER_DEVICE in each for each in device.status(card.now_ns))


def test_outputs_that_another_program_drives_are_not_taken() -> None:
    """Activation says so, and writes nothing."""
    card = FakeCard(locked_by_other=True)
    device = make_device(OPTIONS, WIRING, card)
    device.open()
    with pytest.raises(PortHeldError, match="another program"):
        device.activate(card.now_ns)
    assert not device.write([1.0], card.now_ns)
    assert card.written == []


def test_lines_are_set_read_and_read_back() -> None:
    """They follow the voltages; nothing is an output, or set, before the device is active."""
    card = FakeCard()
    device = make_device(OPTIONS, WITH_LINES, card)
    device.open()
    assert card.driven == set()
    device.activate(card.now_ns)
    assert card.driven == {0, 1}
    for pixel, frame in ((1.0, 0.0), (0.0, 1.0)):
        assert device.write([1.0, pixel, frame], card.now_ns)
        assert (card.levels[0], card.levels[1]) == (pixel, frame)
        assert device.read_back(card.now_ns) == pytest.approx([1.0, pixel, frame], abs=STEP_V)
        card.levels[4] = int(pixel)
        position, camera = device.read(card.now_ns)
        assert (position.valid, camera.valid, camera.position_um) == (True, True, pixel)
    assert not device.write([1.0, 1.1, 0.0], card.now_ns)


def test_card_plays_nothing_while_the_loop_has_its_lines() -> None:
    """It would leave them as they are for the whole play."""
    for wiring in (WITH_LINES, Wiring(("camera",), ("drive",)), Wiring((), ("drive", "pixel"))):
        assert not isinstance(make_device(OPTIONS, wiring, FakeCard()), PlayingBusDevice)


@pytest.mark.parametrize(
    "options",
    [
        {"outputs": {"a": {"number": 0}}, "digital_outputs": {"a": {"number": 0}}},
        {"inputs": {"a": {"number": 0}}, "digital_inputs": {"a": {"number": 0}}},
        {"digital_outputs": {"a": {"number": 0}, "b": {"number": 0}}},
        {},
    ],
)
def test_lines_that_exclude_each_other_are_refused(options: dict[str, object]) -> None:
    """Two channels of one name, two outputs on one line, and no channel at all."""
    with pytest.raises(ValidationError):
        ComediOptions.model_validate(options)


def test_device_without_library_or_card_is_refused() -> None:
    """Opening says what is missing: here the card, if libcomedi is installed."""
    device = PLUGIN.create(ComediOptions(port="/dev/comedi9", outputs=OPTIONS.outputs), WIRING, 1)
    with pytest.raises(DeviceUnavailableError, match="comedi"):
        device.open()


def test_output_without_a_measuring_input_cannot_play() -> None:
    """After a stop in the middle nothing would know its voltage."""
    options = ComediOptions.model_validate({"outputs": {"drive": {"number": 0}}})
    device = make_device(options, Wiring((), ("drive",)), FakeCard())
    assert not isinstance(device, PlayingBusDevice)


def test_card_without_commands_cannot_play() -> None:
    """Its inputs or outputs have no clock."""
    device = opened(FakeCard(has_commands=False))
    with pytest.raises(DeviceError, match="clock"):
        device.player_capabilities()


def test_long_play_is_filled_each_cycle() -> None:
    """A table many times larger than the buffer comes out whole, and its record is the table."""
    card = FakeCard()
    device = opened(card)
    table = device.load(ramp(50_000, cycles=4))
    device.arm()
    device.start(card.now_ns)
    for _ in range(300):
        card.wait(100_000_000)
        progress = device.progress(card.now_ns)
        if progress.state is not PlayState.PLAYING:
            break
    record = device.recording()
    assert progress == (PlayState.ENDED, 4, "")
    assert np.array_equal(record.positions, np.tile(table.period, (4, 1)))
    assert np.array_equal(record.outputs, record.positions)


def test_play_whose_buffer_ran_empty_has_failed() -> None:
    """A host that was late by more than the buffer loses the play, and not the output."""
    card = FakeCard()
    device = opened(card)
    device.load(ramp(100_000))
    device.arm()
    device.start(card.now_ns)
    card.wait(9_000_000_000)
    progress = device.progress(card.now_ns)
    assert progress.state is PlayState.FAILED
    (in_force_v,) = device.abort(card.now_ns)
    assert in_force_v == CONVERTER.value(card.codes[0])
    assert device.write([0.0], card.now_ns)


def test_card_lost_in_a_play() -> None:
    """The play has failed, and the device is lost until it is opened again."""
    card = FakeCard()
    device = opened(card)
    device.load(ramp(1000, cycles=100))
    device.arm()
    device.start(card.now_ns)
    card.refuses = errno.ENODEV
    assert device.progress(card.now_ns).state is PlayState.FAILED
    assert device.lost


def test_play_without_inputs_reads_the_outputs_back_one_by_one() -> None:
    """There is no record, and the value in force is measured during the play."""
    card = FakeCard()
    device = opened(card, Wiring((), ("drive",)))
    device.load(ramp(100))
    device.arm()
    device.start(card.now_ns)
    card.wait(5_000_000)
    assert device.read_back(card.now_ns) == [CONVERTER.value(card.codes[0])]
    card.wait(50_000_000)
    assert device.progress(card.now_ns).state is PlayState.ENDED
    assert device.recording().positions.shape == (0, 0)


@given(st.lists(st.binary(max_size=9)), st.integers(1, 4))
def test_record_is_whole_in_whatever_pieces_it_comes(pieces: list[bytes], width: int) -> None:
    """The kept bytes are all whole scans, and the newest one is the last of them."""
    stream = InStream(width, 10)
    for piece in pieces:
        stream.add(piece)
    data = b"".join(pieces)
    whole = data[: len(data) // width * width]
    assert stream.kept() == whole
    assert stream.newest == whole[-width:]


@given(st.binary(max_size=5), st.binary(min_size=1, max_size=5), st.integers(1, 4), st.data())
def test_points_go_out_in_order(
    lead_in: bytes, period: bytes, cycles: int, data: st.DataObject
) -> None:
    """Whatever the card takes each time, all bytes go out once, in their order."""
    stream, out = OutStream(lead_in, period, cycles), b""
    while part := stream.next():
        n = data.draw(st.integers(1, len(part)))
        out += bytes(part[:n])
        stream.took(n)
    assert out == lead_in + period * cycles
    assert stream.complete
