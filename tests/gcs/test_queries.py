"""Queries of a stage that is served as a GCS controller."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.messages.answers import AXIS
from tests.gcs.fake_stage import IDENTITY, Controller, Dialogue, gone


@pytest.mark.parametrize(
    ("query", "reply"),
    [
        ("*IDN?", f"{IDENTITY}\n"),
        ("CSV?", "2.0\n"),
        ("ERR?", "0\n"),
        ("SAI?", "1 \n2\n"),
        ("SAI? ALL", "1 \n2\n"),
        ("TPC?", "2\n"),
        ("CST?", "1=x \n2=y\n"),
        ("POS?", "1=1.500000 \n2=1.500000\n"),
        ("POS? 2", "2=1.500000\n"),
        ("pos? 2 1", "2=1.500000 \n1=1.500000\n"),
        ("MOV? 2", "2=1.500000\n"),
        ("VOL? 1", "1=20.250000\n"),
        ("SVO?", "1=0 \n2=0\n"),
        ("ONT? 1", "1=0\n"),
        ("TMN? 1", "1=0.000000\n"),
        ("TMX? 1", "1=20.000000\n"),
        ("NLM? 1", "1=0.000000\n"),
        ("PLM? 1", "1=20.000000\n"),
        ("VEL? 1", "1=100.000000\n"),
        ("FRF? 1", "1=1\n"),
        ("TRS? 1", "1=0\n"),
        ("PUN? 1", "1=um\n"),
        ("ONL? 1", "1=1\n"),
        ("SPA? 1 0x07000601", "1 0x07000601=um\n"),
        ("SPA? 1 117440513", "1 117440513=20.000000\n"),
        ("SRG? 2 1", "2 1=0x0000\n"),
        ("\x05", "0\n"),
        ("\x07", "\xb1\n"),
        ("", ""),
    ],
)
def test_query_of_a_disarmed_stage(client: Dialogue, query: str, reply: str) -> None:
    """A query has its reply, and leaves no error; nothing is requested of the stage."""
    assert client.ask(query) == reply
    assert client.ask("ERR?") == "0\n"


def test_help_lists_every_command(client: Dialogue) -> None:
    """Between a first and a last line, `HLP?` has one line for each command."""
    first, *texts, last = client.ask("HLP?").split(" \n")

    assert "valid" in first
    assert last == "end of help\n"
    names = [text.split()[0] for text in texts]
    assert {"MOV", "MOV?", "SVO", "#5", "#24", "*IDN?"} <= set(names)
    assert len(names) == len(set(names))
    position, unit = AXIS["position_um"].shown.what, client.ask("PUN? 1")
    assert f"POS? [{{<axis>}}]: {position}, {unit[2:-1]}" in texts


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("FOO?", 2),
        ("SVA 1 5", 2),
        ("POS? " + "1 " * 130, 3),
        ("POS? 3", 15),
        ("MOV 3 1", 15),
        ("SVO 1 2", 17),
        ("SRG? 1 2", 17),
        ("MOV 1", 24),
        ("MOV", 24),
        ("MOV 1 nan", 25),
        ("MOV 1 1e999", 25),
        ("MOV 1 1_0", 25),
        ("SPA? 1 0x3C", 54),
        ("SPA? 1 foo", 54),
    ],
)
def test_wrong_line_has_no_reply_but_an_error(
    controller: Controller, client: Dialogue, line: str, code: int
) -> None:
    """`ERR?` reports the error once, the reason is reported in words, nothing is requested."""
    assert client.error_of(line) == code
    assert client.ask("ERR?") == "0\n"
    assert f"error {code}: " in client.reports[-1]
    assert controller.stage.requests == []


def test_missing_values_are_not_invented(controller: Controller, client: Dialogue) -> None:
    """Without a valid sample `POS?` is refused, and `MOV?` too while there is no command."""
    with controller.changing() as stage:
        stage.axes["x"]["position_um"] = None

    assert client.error_of("POS? 1") == 505
    assert client.error_of("POS?") == 505
    assert client.error_of("MOV? 1") == 505
    assert client.ask("POS? 2") == "2=1.500000\n"


def test_axis_without_a_range_has_no_limits(controller: Controller, client: Dialogue) -> None:
    """Without `command_range_um` the limits are not known."""
    for axis in controller.stage.config["axes"].values():
        del axis["command_range_um"]

    assert client.error_of("TMX? 1") == 34


def test_single_bytes_work_inside_a_line(client: Dialogue) -> None:
    """A single byte is answered at once, and the line around it is kept."""
    assert client.send(b"CS\x05V?\r\n") == b"0\n2.0\n"


def test_line_in_pieces(client: Dialogue) -> None:
    """Bytes may arrive one by one, and several lines at once."""
    assert b"".join(client.send(bytes([each])) for each in b"CSV?\nERR?\n") == b"2.0\n0\n"
    assert client.send(b"CSV?\nERR?\n") == b"2.0\n0\n"


def test_daemon_that_has_ended(controller: Controller, client: Dialogue) -> None:
    """Commands and queries are refused until the daemon is back; the connection stays."""
    with controller.changing() as stage:
        stage.errors = {"status": gone()}
    assert client.error_of("POS? 1") == 215
    assert client.error_of("MOV 1 2") == 215
    assert client.ask("\x07") == "\xb0\n"
    assert client.ask("*IDN?") == f"{IDENTITY}\n"

    controller.stage.errors = {}
    assert client.ask("POS? 1") == "1=1.500000\n"


@pytest.mark.parametrize("method", ["GET", "POST", "OPTIONS"])
def test_browser_is_thrown_out(controller: Controller, client: Dialogue, method: str) -> None:
    """A web page cannot command the stage in the body of a request."""
    request = f"{method} /{'a' * 300} HTTP/1.1\r\nHost: a\r\n\r\nSVO 1 1\nMOV 1 5\n"

    with pytest.raises(ConnectionAbortedError, match="not HTTP"):
        client.send(request.encode())
    assert controller.stage.requests == []


def test_encrypted_connection_does_not_stop_the_stage(
    controller: Controller, client: Dialogue
) -> None:
    """The random bytes of TLS are no commands of a single byte."""
    with pytest.raises(ConnectionAbortedError, match="not TLS"):
        client.send(b"\x16\x03\x01\x02\x00\x01\x18\x18\n")
    assert controller.stage.requests == []


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=300),
            st.sampled_from([b"\n", b"POS?", b"MOV 1 ", b"SPA? 1 0x", b"\x05", b"\x18", b" "]),
        ),
        max_size=12,
    )
)
def test_no_bytes_break_the_dialogue(pieces: list[bytes]) -> None:
    """After any bytes the dialogue goes on; a disarmed stage is not armed by them."""
    controller = Controller("x")
    with controller.runner:
        client = controller.client()
        for piece in pieces:
            with suppress(ConnectionAbortedError):
                client.send(piece)
        client.send(b"\n")

        assert client.ask("CSV?") == "2.0\n"
        assert set(controller.stage.paths()) <= {"hold"}
