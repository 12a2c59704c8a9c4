"""Signals in frames agree with the cantools library, and decoding never fails."""

from pathlib import Path
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.dbc.checksum import ALGORITHMS, crc8_j1850
from piezod_drivers.can_bus.dbc.codec import DbcMessage, DbcSignal, SignalReader, SignalWriter
from piezod_drivers.can_bus.dbc.database import DatabaseError, load
from piezod_drivers.can_bus.dbc.emulator import COMMAND, POLL, REPORT, STATUS
from piezod_drivers.can_bus.dbc.messages import Checksum, ReceivedMessage, SentMessage
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.profiles import DBC

FLOAT_SLACK = 1e-9


@st.composite
def signals(draw: Any) -> DbcSignal:
    """Draw a signal that fits into eight bytes."""
    bits = draw(st.integers(1, 64))
    big = draw(st.booleans())
    low = draw(st.integers(0, 64 - bits))
    # A DBC file numbers the bits of a big-endian signal from its highest bit downwards.
    start = low // 8 * 8 + 7 - low % 8 if big else low
    return DbcSignal("S", start, bits, big, draw(st.booleans()))


def _message(signal: DbcSignal) -> DbcMessage:
    return DbcMessage("M", 1, 8, False, {"S": signal})


def _theirs(signal: DbcSignal) -> Any:
    order: Any = "big_endian" if signal.big_endian else "little_endian"
    one = cantools.database.Signal("S", signal.start, signal.bits, order, is_signed=signal.signed)
    return cantools.database.Message(1, "M", 8, [one])


@given(signals(), st.binary(min_size=8, max_size=8))
@pytest.mark.confirms(
    "can_dbc", "can_dbc", part="bits of read signals", by="cantools", kind="client"
)
def test_reading_agrees_with_cantools(signal: DbcSignal, data: bytes) -> None:
    """A signal read from any eight bytes has the value that cantools reads."""
    theirs = _theirs(signal).decode(data, scaling=False)

    assert SignalReader(_message(signal), "S").raw(data) == theirs["S"]


@given(signals(), st.data())
@pytest.mark.confirms(
    "can_dbc", "can_dbc", part="bits of written signals", by="cantools", kind="client"
)
def test_writing_agrees_with_cantools(signal: DbcSignal, data: Any) -> None:
    """A number is written to the bits that cantools uses; other bits do not change."""
    raw = data.draw(st.integers(*signal.raw_range))
    ours = bytearray(8)
    SignalWriter(_message(signal), "S").put_raw(ours, raw)
    assert bytes(ours) == _theirs(signal).encode({"S": raw}, scaling=False)

    ours = bytearray(b"\xff" * 8)
    SignalWriter(_message(signal), "S").put_raw(ours, raw)
    SignalWriter(_message(signal), "S").put_raw(ours, -1)
    assert bytes(ours) == b"\xff" * 8


@given(st.floats(-1e6, 1e6), st.sampled_from([0.005, 1.0, -0.5]), st.floats(-100, 100))
def test_value_survives_within_a_step(value: float, scale: float, offset: float) -> None:
    """A value read back differs from the written one by at most half a step or is an end."""
    signal = DbcSignal("S", 3, 17, False, True, scale, offset)
    low, high = signal.range
    data = bytearray(8)
    SignalWriter(_message(signal), "S").put(data, value)
    expected = min(max(value, low), high)

    assert SignalReader(_message(signal), "S").value(bytes(data)) == pytest.approx(
        expected, abs=abs(scale) / 2 + FLOAT_SLACK
    )


def test_value_out_of_its_range_is_none() -> None:
    """A value beyond the range of the DBC file is NaN."""
    signal = DbcSignal("S", 0, 16, lowest=0.0, highest=100.0)
    reader = SignalReader(_message(signal), "S")

    assert reader.value((100).to_bytes(8, "little")) == 100.0
    assert reader.value((101).to_bytes(8, "little")) != reader.value((101).to_bytes(8, "little"))


def test_checksums_are_as_published() -> None:
    """The CRC has its published check value; sum and xor are the sum and the exclusive or."""
    assert crc8_j1850(b"123456789") == 0x4B
    assert ALGORITHMS["xor"](b"\x01\x03") == 2
    assert ALGORITHMS["sum"](b"\xff\x02") == 1


CHECKSUM = Checksum(STATUS, "Crc", "crc8_j1850")


@given(st.integers(0, 63))
@pytest.mark.sees("can_dbc", "B4")
def test_each_flipped_bit_is_seen(bit: int) -> None:
    """The checksum detects any flipped bit of a frame."""
    sent = SentMessage(STATUS, {"Echo": 7}, "Counter", CHECKSUM)
    frame = sent.next()
    received = ReceivedMessage(STATUS, "Counter", "Echo", CHECKSUM)
    received.require_valid(frame)
    flipped = bytearray(frame.data)
    flipped[bit // 8] ^= 1 << bit % 8

    with pytest.raises(LineFault) as failure:
        received.require_valid(frame._replace(data=bytes(flipped)))
    assert failure.value.flag == DeviceFlag.BAD_CHECKSUM


@given(st.binary(max_size=8), st.booleans(), st.booleans())
def test_any_frame_is_taken_or_refused(data: bytes, extended: bool, remote: bool) -> None:
    """A frame with any content is valid or is refused with a `LineFault`."""
    received = ReceivedMessage(STATUS, "Counter", "Echo", CHECKSUM)
    frame = Frame(STATUS.id, data, extended, remote)
    try:
        received.require_valid(frame)
    except LineFault as fault:
        assert fault.flag in {DeviceFlag.GARBAGE, DeviceFlag.BAD_CHECKSUM}
    else:
        received.is_newer(frame)
        received.answers_request(frame, 7)


@pytest.mark.sees("can_dbc", "B6")
def test_repeated_counter_marks_an_old_value() -> None:
    """A repeated or overtaken frame is old; a frame after a gap is new."""
    sent = SentMessage(REPORT, {}, "Counter", None)
    frames = [sent.next() for _ in range(300)]
    received = ReceivedMessage(REPORT, "Counter", None, None)

    assert all(received.is_newer(frame) for frame in frames[:200])
    assert not received.is_newer(frames[199])
    assert not received.is_newer(frames[197])
    assert received.is_newer(frames[205])


def test_sender_that_begins_anew_is_believed() -> None:
    """A restarted counter is old at first, and new when it counts on from there."""
    received = ReceivedMessage(REPORT, "Counter", None, None)
    old = SentMessage(REPORT, {}, "Counter", None)
    for _ in range(50):
        assert received.is_newer(old.next())
    new = SentMessage(REPORT, {}, "Counter", None)

    assert [received.is_newer(new.next()) for _ in range(5)] == [False, False, True, True, True]


@pytest.mark.parametrize("ours", [COMMAND, POLL, STATUS, REPORT], ids=lambda ours: ours.name)
def test_emulated_device_fits_its_dbc_file(ours: DbcMessage) -> None:
    """Each frame of the emulated device has the identifier, length and signals of its DBC file."""
    file = load(DBC)[ours.name]

    assert file[:4] == ours[:4]
    for name, signal in ours.signals.items():
        assert file.signals[name][:7] == signal[:7]


def test_file_that_is_none_is_refused(tmp_path: Path) -> None:
    """A missing or invalid DBC file is an error with its name."""
    with pytest.raises(DatabaseError, match=r"nowhere\.dbc cannot be read"):
        load(tmp_path / "nowhere.dbc")
    wrong = tmp_path / "wrong.dbc"
    wrong.write_bytes(b"\x00\xff hello")
    with pytest.raises(DatabaseError, match=r"wrong\.dbc cannot be read"):
        load(wrong)


def test_library_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without cantools a DBC file is refused with the command to install the library."""
    monkeypatch.setitem(__import__("sys").modules, "cantools", None)

    with pytest.raises(DatabaseError, match=r'pip install "piezod\[can\]"'):
        load(tmp_path / "any.dbc")
