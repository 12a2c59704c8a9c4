import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.thorlabs_mdt.codec import (
    Replies,
    identity_in,
    number_in,
    prompt_in,
    tail_in,
)

MODERN = Replies(b">", b"\r>")
LEGACY = Replies(b"*", b"\r")
BYTES = st.binary(max_size=300) | st.text("[]012.,*!>\r CMD_", max_size=300).map(str.encode)


@pytest.mark.parametrize(
    ("replies", "frame", "values"),
    [
        (MODERN, b"[ 12.30]\r>", [12.3]),
        (MODERN, b"XVOLTAGE?\r[ 12.30]\r>", [12.3]),
        (MODERN, b"[ 1.00,  2.50, -0.10]\r>", [1.0, 2.5, -0.1]),
        (LEGACY, b"*[ 12.3]\r", [12.3]),
        (LEGACY, b"xr?\r*[ 12.3]\r", [12.3]),
        (Replies(b"*", b"\r*"), b"[ 12.3]\r*", [12.3]),
    ],
)
def test_values(replies: Replies, frame: bytes, values: list[float]) -> None:
    """Voltages in brackets are read, whatever is around them; an incomplete reply is none."""
    assert replies.values_length(frame + b"rest") == len(frame)
    assert replies.values(frame, len(values)) == values
    assert [replies.values_length(frame[:n]) for n in range(len(frame))] == [0] * len(frame)
    with pytest.raises(LineFault) as caught:
        replies.values(frame, len(values) + 1)
    assert caught.value.flag is DeviceFlag.GARBAGE


@pytest.mark.parametrize(
    ("replies", "frame"), [(MODERN, b">"), (MODERN, b"XVOLTAGE=1.000\r>"), (LEGACY, b"*")]
)
def test_settings_that_are_taken(replies: Replies, frame: bytes) -> None:
    """A prompt without text acknowledges a setting."""
    assert replies.acknowledgement_length(frame) == len(frame)
    replies.check(frame)


@pytest.mark.parametrize(
    ("replies", "frame"),
    [
        (MODERN, b"CMD_ARG_INVALID>"),
        (MODERN, b"CMD_NOT_DEFINED>"),
        (MODERN, b"Error>"),
        (LEGACY, b"!"),
    ],
)
def test_refused_values(replies: Replies, frame: bytes) -> None:
    """A refusal, by text or exclamation mark, is a wrong request."""
    for length in (replies.acknowledgement_length(frame), replies.values_length(frame)):
        assert length == len(frame)
    for read in (replies.check, lambda got: replies.values(got, 1)):
        with pytest.raises(LineFault, match="the amplifier refuses") as caught:
            read(frame)
        assert caught.value.flag is DeviceFlag.WRONG_REQUEST


@pytest.mark.parametrize(
    ("data", "length"), [(b">", -1), (b"ab>[ 1.0]\r>", -3), (b"[junk]\r>", -8), (b"[", 0)]
)
def test_text_without_a_value(data: bytes, length: int) -> None:
    """The reply to a setting, or an invalid value, is dropped when a value is expected."""
    assert MODERN.values_length(data) == length


def test_a_value_is_no_acknowledgement() -> None:
    """A late voltage is not taken for the reply to a setting."""
    assert MODERN.acknowledgement_length(b"[ 12.30]\r>") == -10


def test_endless_noise_is_dropped() -> None:
    """Noise without an end is dropped before it takes time."""
    for replies in (MODERN, LEGACY):
        assert replies.acknowledgement_length(b"x" * 600) == -600
        assert replies.values_length(b"x" * 600) == -600


@given(data=BYTES)
def test_any_bytes(data: bytes) -> None:
    """Any bytes are frames, garbage or incomplete, and raise only line faults."""
    for replies in (MODERN, LEGACY):
        for length_of in (replies.acknowledgement_length, replies.values_length):
            rest = data
            while length := length_of(rest):
                frame, rest = rest[: abs(length)], rest[abs(length) :]
                try:
                    replies.check(frame)
                    assert len(replies.values(frame, 1)) == 1
                except LineFault:
                    continue


@given(reply=BYTES)
def test_any_bytes_while_opening(reply: bytes) -> None:
    """Any bytes raise nothing while the device is opened."""
    assert prompt_in(reply) in {b"", b">", b"*"}
    number_in(reply, b"XMIN?\r")
    tail_in(reply)
    identity = identity_in(reply)
    assert identity is None or all(identity)


def test_identity() -> None:
    """Model, serial number and firmware are found in the lines of a reply."""
    reply = b"ID?\r*\r\r\rModel MDT693B Piezo Control Module\rFirmware Version: 1.05\r"
    assert identity_in(reply) == ("Thorlabs", "MDT693B", "unknown", "1.05")
    assert identity_in(reply + b"Serial#: 140421-07\r") == (
        "Thorlabs",
        "MDT693B",
        "140421-07",
        "1.05",
    )
    assert identity_in(b"APT cube") is None


@pytest.mark.parametrize(
    ("reply", "number"),
    [(b"*0", 0.0), (b"[ 150]\r>", 150.0), (b"%\r*[ 100]\r*", 100.0), (b"!", None), (b"", None)],
)
def test_numbers(reply: bytes, number: float | None) -> None:
    """A limit is in brackets or bare; an error has none."""
    assert number_in(reply, b"%\r") == number


@pytest.mark.parametrize(
    ("frame", "taken"),
    [
        (b">", True),
        (b"\r\n>", True),
        (b"XVOLTAGE=1.000\r\n>", True),
        (b"CMD_NOT_DEFINED>", True),
        (b"!", True),
        (b"Temp warning\r>", False),
        (b"XVOLTAGE=2.000\r>", False),
    ],
)
def test_answers_to_a_setting(frame: bytes, taken: bool) -> None:
    """Only a prompt, a prompt behind the echo, or a refusal answers a setting."""
    assert Replies(b">", b"").is_acknowledgement(frame, b"XVOLTAGE=1.000\r") == taken


def test_answers_to_a_query() -> None:
    """The requested number of voltages, or a refusal, answers a query."""
    replies = Replies(b">", b"\r>")
    assert replies.has_values(b"[ 1.00, 2.00, 3.00]\r>", 3)
    assert not replies.has_values(b"[ 1.00]\r>", 3)
    assert not replies.has_values(b"[ 1.00, 2.00, 3.00]\r>", 1)
    assert replies.has_values(b"CMD_ARG_RANGE_ERR>", 1)
