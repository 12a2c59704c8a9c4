"""Commands and replies of piezosystem jena's amplifiers, with any bytes."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.conversation import LengthOf
from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PROFILES, ProfileName
from tests.drivers.serial_line.psj_rig import ALL, Rig

FINDERS = [codec.framed, codec.line, codec.ended_by_cr, codec.prompt, codec.versions]
ANYTHING = st.binary(max_size=400) | st.lists(
    st.sampled_from([b"\x13", b"\x11", b"\r\n", b"\r", b">", b"set", b",", b"0.5", b"ErrorCode,"]),
    max_size=40,
).map(b"".join)


@pytest.mark.parametrize(
    ("profile", "request_"),
    [("ddrive", b"set,0,12.500\r\n"), ("30dv", b"set,12.500\r\n"), ("nv40", b"set,0,12.500\r")],
)
def test_a_setpoint_names_the_channel_where_there_are_several(
    profile: ProfileName, request_: bytes
) -> None:
    """Commands look as in the public sources."""
    assert codec.command(PROFILES[profile], "set", 0, 12.5) == request_


@pytest.mark.parametrize(
    ("find", "got", "length"),
    [
        (codec.framed, b"\x13mess,0,1.5\r\n\x11", 14),
        (codec.framed, b"\x13\x11", 2),
        (codec.framed, b"mess,0,1.5\r\n\x11\x13", 13),
        (codec.framed, b"noise\x13mess", -5),
        (codec.framed, b"\x13mess,0", 0),
        (codec.framed, b"x" * 300, -300),
        (codec.line, b"rd,1.5\r\nrd", 8),
        (codec.line, b"rd,1.5\r\n\x11", 9),
        (codec.ended_by_cr, b"modon,0,0\r", 10),
        (codec.ended_by_cr, b"modon,0,0\r\n\x11", 12),
        (codec.prompt, b"NV401CL>\r\n", 10),
        (codec.versions, b"ver,1\r\n\x11sdate,2\r\n\x11serno,3\r\n\x11", 28),
        (codec.versions, b"ver,1\r\n\x11sdate,2\r\n\x11", 0),
        (codec.versions, b"\x13ErrorCode,11\r\n\x11", 16),
    ],
)
def test_the_end_of_an_answer_is_found(find: LengthOf, got: bytes, length: int) -> None:
    """Every kind of reply ends as in the public sources."""
    assert find(got) == length


@given(ANYTHING)
def test_any_bytes_are_a_frame_or_garbage_or_not_enough(got: bytes) -> None:
    """Any bytes make a finder neither raise, nor exceed them, nor wait for ever."""
    for find in FINDERS:
        length = find(got)

        assert abs(length) <= len(got)
        assert length or len(got) <= codec.LONGEST


@given(ANYTHING)
def test_no_answer_raises_anything_but_a_fault_of_the_line(frame: bytes) -> None:
    """Any reply is a text with values, or raises a `LineFault`."""
    codec.serial_of(frame)
    with suppress(LineFault):
        (field,) = codec.fields(codec.text_of(frame), "mess", 0, 1)
        codec.number(field)
        codec.word(field, 10)


@given(st.floats(-999, 999), st.sampled_from(ALL))
def test_a_value_comes_back_as_it_was_sent(value: float, profile: ProfileName) -> None:
    """A number with three decimals is read as the same number."""
    text = codec.text_of(codec.command(PROFILES[profile], "mess", 0, value))
    channel = 0 if PROFILES[profile].numbered else None

    assert codec.number(codec.fields(text, "mess", channel, 1)[0]) == pytest.approx(value, abs=6e-4)


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "1_0", "1,5", "0x10", "\N{ARABIC-INDIC DIGIT ONE}", "1e999", "--1"]
)
def test_text_without_a_number_is_garbage(text: str) -> None:
    """A number has only digits, a point and an exponent."""
    with pytest.raises(LineFault) as caught:
        codec.number(text)
    assert caught.value.flag is DeviceFlag.GARBAGE


@pytest.mark.parametrize("text", ["", "-1", "xyz", "1f", "1_0"])
def test_other_status_word_is_garbage(text: str) -> None:
    """A decimal status word has only digits."""
    with pytest.raises(LineFault) as caught:
        codec.word(text, 10)
    assert caught.value.flag is DeviceFlag.GARBAGE


@pytest.mark.parametrize(
    ("text", "flag"),
    [
        ("mess,1,2.0", DeviceFlag.OUT_OF_ORDER),
        ("stat,0,2", DeviceFlag.OUT_OF_ORDER),
        ("", DeviceFlag.OUT_OF_ORDER),
        ("mess,0", DeviceFlag.GARBAGE),
        ("mess,0,1,2", DeviceFlag.GARBAGE),
    ],
)
def test_an_answer_to_something_else_is_not_taken(text: str, flag: DeviceFlag) -> None:
    """A reply that names another command or channel is refused."""
    with pytest.raises(LineFault) as caught:
        codec.fields(text, "mess", 0, 1)
    assert caught.value.flag is flag


@given(st.lists(ANYTHING, max_size=5), st.sampled_from(ALL))
def test_an_emulator_answers_anything_without_raising(
    parts: list[bytes], profile: ProfileName
) -> None:
    """Any bytes make an emulated device raise nothing."""
    emulator = Rig(profile).emulator

    for part in parts:
        assert all(reply for reply in emulator.receive(part))


@pytest.mark.parametrize(
    ("profile", "request_", "reply"),
    [
        ("ddrive", b"\r\n", b"\x13DSM V6.000\r\n\x11"),
        ("ddrive", b"set,0,1\r\n", b"\x13\x11"),
        ("ddrive", b"set,9,1\r\n", b"\x13channel not present\r\n\x11"),
        ("ddrive", b"what\r\n", b"\x13command not found\r\n\x11"),
        ("ddrive", b"set,0,1,2\r\n", b"\x13command mismatch\r\n\x11"),
        ("ddrive", b"kp,0\r\n", b"kp,0,0\r"),
        ("ddrive", b"kp,0,3\r\n", b"\x13\x11"),
        ("ddrive", b"mess,0\r\n", b"\x13mess,0,0.0000\r\n\x11"),
        ("nv40", b"dspvmin\r", b"\x13dspvmin,0.000\r\n\x11"),
        ("nv40", b"dspvmax\r", b"\x13dspvmax,150.000\r\n\x11"),
        ("nv40", b"dspvmin,0\r", b"\x13ErrorCode,11\r\n\x11"),
        ("nv40", b"what\r", b"\x13ErrorCode,11\r\n\x11"),
        ("nv40", b"set,7,1\r", b"\x13ErrorCode,15\r\n\x11"),
        ("nv40", b"set\r", b"\x13ErrorCode,17\r\n\x11"),
        ("nv40", b"set,0,999\r", b"\x13ErrorCode,18\r\n\x11"),
        ("nv200", b"\r", b"\x13NV200/D_NET>\r\n\x11"),
        ("nv200", b"what\r", b"\x13error,2\r\n\x11"),
        ("nv200", b"set,999\r", b"\x13error,4\r\n\x11"),
        ("nv200", b"set,inf\r", b"\x13error,4\r\n\x11"),
        ("nv200", b"set,1,2\r", b"\x13error,5\r\n\x11"),
        ("nv200", b"set,x\r", b"\x13error,3\r\n\x11"),
    ],
)
def test_emulators_answer_as_public_sources_say(
    profile: ProfileName, request_: bytes, reply: bytes
) -> None:
    """Greetings, frames and errors are those of the vendor's library."""
    assert Rig(profile).emulator.receive(request_) == [reply]
