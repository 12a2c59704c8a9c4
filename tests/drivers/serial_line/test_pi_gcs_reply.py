import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.gcs.errors import ERRORS, fault_of
from piezod_drivers.serial_line.gcs.identity import identity_of
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.pi_gcs1.codec import Gcs1Syntax
from piezod_drivers.serial_line.pi_gcs2.codec import Gcs2Syntax

TWO = GcsReply(*Gcs2Syntax().numbers(["1", "2"]), *Gcs2Syntax().numbers(["1", "2"]))
LETTER = GcsReply(*Gcs1Syntax().numbers(["A"]), *Gcs1Syntax().numbers(["A"]))
SWITCH = GcsReply(*Gcs1Syntax().switches(["A"]), whole=True)
GOOD = b"1=5.25 \n2=-6\n1=33.1 \n2=4e1\n0\n"
REPLIES = [TWO, LETTER, SWITCH, GcsReply(), GcsReply(Gcs2Syntax().axes(), whole=True)]


def frames_of(reply: GcsReply, data: bytes) -> list[bytes]:
    """Return all frames in some bytes, as a conversation finds them."""
    frames = []
    while length := reply.length_of(data):
        if length > 0:
            frames.append(data[:length])
        data = data[abs(length) :]
    return frames


def test_lines_of_a_reply() -> None:
    """A line with a space before its end has another one behind it; values keep their order."""
    assert TWO.length_of(GOOD) == len(GOOD)
    assert TWO.numbers(GOOD) == [5.25, -6.0, 33.1, 40.0]


@pytest.mark.parametrize("n", range(len(GOOD)))
def test_a_part_is_no_reply(n: int) -> None:
    """While a byte is missing, nothing is a frame and nothing is garbage."""
    assert TWO.length_of(GOOD[:n]) == 0


@pytest.mark.parametrize("number", [b"1e400", b"-9e999"])
def test_infinity_is_no_number(number: bytes) -> None:
    """An infinite number is garbage, never a voltage."""
    with pytest.raises(LineFault) as fault:
        TWO.numbers(GOOD.replace(b"33.1", number))
    assert fault.value.flag == DeviceFlag.GARBAGE


def test_bare_replies() -> None:
    """Replies of the first generation are recognized by their order."""
    assert LETTER.numbers(b"+0010.5000\n-0003.2500\n0\n") == [10.5, -3.25]
    assert SWITCH.texts(b"1\n0\n") == [b"1"]


@pytest.mark.parametrize("reply", [TWO, LETTER, GcsReply()])
def test_an_error_instead_of_replies(reply: GcsReply) -> None:
    """If a query has no reply, the error behind it is the frame and is raised."""
    assert reply.length_of(b"2\n") == 2
    with pytest.raises(LineFault, match="error 2: unknown command") as caught:
        reply.numbers(b"2\n")
    assert caught.value.flag is DeviceFlag.WRONG_REQUEST


def test_a_reply_that_is_missing_without_error() -> None:
    """If a reply was lost, no other one is taken for it."""
    frame = b"1=5.25 \n2=6\n0\n"
    assert TWO.length_of(frame) == len(frame)
    with pytest.raises(LineFault, match="a reply is missing") as caught:
        TWO.numbers(frame)
    assert caught.value.flag is DeviceFlag.GARBAGE


@pytest.mark.parametrize("noise", [b"xyz\n", b"\xff\xfe\n", b"\n", b"1=5.25 \n3=1\n", b"1=\n"])
def test_noise_before_a_reply(noise: bytes) -> None:
    """A line that cannot be a reply is dropped, and the frame behind it is found."""
    assert frames_of(TWO, noise + GOOD) == [GOOD]


def test_a_reply_that_comes_twice() -> None:
    """A superfluous reply is dropped."""
    doubled = b"1=5.25 \n2=-6\n" + GOOD
    assert frames_of(TWO, doubled)[-1] == GOOD


def test_endless_noise_is_dropped() -> None:
    """Noise without an end is dropped before it takes time."""
    assert TWO.length_of(b"1" * 5000) == -5000


def test_no_reply_at_all_is_read() -> None:
    """Bytes that are no frame raise the documented fault."""
    with pytest.raises(LineFault, match="not a reply of a controller"):
        TWO.numbers(b"hello\n")


@pytest.mark.parametrize("reply", REPLIES)
@given(data=st.binary(max_size=200) | st.text("012=. \n+-eE", max_size=200).map(str.encode))
def test_any_bytes(reply: GcsReply, data: bytes) -> None:
    """Any bytes are frames, garbage or incomplete, and raise only line faults."""
    for frame in frames_of(reply, data):
        try:
            texts = reply.texts(frame)
        except LineFault:
            continue
        assert all(isinstance(text, bytes) for text in texts)


@given(data=st.binary(max_size=200))
def test_numbers_are_finite_or_faults(data: bytes) -> None:
    """Numbers are as many as requested and finite, or raise a fault."""
    for frame in frames_of(TWO, data + GOOD):
        try:
            assert len(TWO.numbers(frame)) == 4
        except LineFault:
            continue


@pytest.mark.parametrize(
    ("idn_reply", "expected"),
    [
        (b"(c)2015 PI GmbH & Co. KG, E-727.3CDA, 12, 14.1", ("(c)2015 PI GmbH & Co. KG", "12")),
        (b"(c)2015 PI, Karlsruhe, E-816, 12, 14.1", ("(c)2015 PI, Karlsruhe", "12")),
        (b"E-816", ("Physik Instrumente", "unknown")),
        (b", ,", ("Physik Instrumente", "unknown")),
        (b"", ("Physik Instrumente", "unknown")),
    ],
)
def test_identity(idn_reply: bytes, expected: tuple[str, str]) -> None:
    """Maker and serial number are found in spite of commas; no part is empty."""
    identity = identity_of(idn_reply)
    assert (identity.maker, identity.serial) == expected
    assert all(identity)


@given(idn_reply=st.binary(max_size=100))
def test_any_identity(idn_reply: bytes) -> None:
    """Any bytes give four parts, none of them empty."""
    assert all(identity_of(idn_reply))


def test_errors_have_flags() -> None:
    """Every listed error has a flag and a text; any other is a failure of the device."""
    assert all(fault_of(code).flag is flag for code, (flag, _) in ERRORS.items())
    assert fault_of(-17).flag is DeviceFlag.DEVICE_FAILURE
