import os
from collections.abc import Iterator

import httpx
import pytest

from piezod.daemon.service.connection import ConnectionLimits
from piezod.messages.requests import Stream
from tests.daemon.service.conftest import Serve
from tests.daemon.service.fakes import Served
from tests.daemon.service.raw import HEAD, connected, read_to_end
from tests.daemon.waiting import eventually

CHUNKED = HEAD % b"stream" + b"transfer-encoding: chunked\r\n\r\n"


def _chunk(line: bytes) -> bytes:
    return b"%x\r\n%s\r\n" % (len(line), line)


def test_each_line_is_a_setpoint(served: Served, client: httpx.Client) -> None:
    """Each line takes effect, also if a chunk ends within a line."""
    pieces = [b'{"x": 1.0, "y"', b': 2.0}\n\n{"x": 3', b'}\r\n{"y": -4.5}']
    answer = client.post("stream", content=iter(pieces))

    assert answer.json() == {"accepted": True, "setpoints": 3}
    assert served.stage.requests == [Stream(axes=("x", "y"))]
    assert served.stage.setpoints == [{"x": 1.0, "y": 2.0}, {"x": 3.0}, {"y": -4.5}]


def test_setpoint_takes_effect_as_it_arrives(served: Served, client: httpx.Client) -> None:
    """The stage follows a stream before its end."""
    seen = []

    def lines() -> Iterator[bytes]:
        for position in (1.0, 2.0):
            yield b'{"x": %f}\n' % position
            eventually(lambda: len(served.stage.setpoints) == int(position))  # noqa: B023 - at once
            seen.append(served.stage.setpoints[-1])

    client.post("stream", content=lines())

    assert seen == [{"x": 1.0}, {"x": 2.0}]


def test_end_of_a_stream_is_answered_when_the_stage_holds(
    served: Served, client: httpx.Client
) -> None:
    """A command after the end finds the stage in HOLD."""
    states = ["RUN", "RUN", "HOLD"]
    served.stage.next_states, served.stage.state = states, "HOLD"
    client.post("stream", content=iter([b'{"x": 1.0}\n']))

    assert states == []


def test_thousands_of_setpoints_in_one_piece_are_taken(client: httpx.Client) -> None:
    """A client that sends faster than the service reads loses no setpoint."""
    answer = client.post("stream", content=b'{"x": 1.0}\n' * 5000)

    assert answer.json()["setpoints"] == 5000


@pytest.mark.fault("C10")
@pytest.mark.parametrize(
    ("line", "status"),
    [
        (b'{"x": NaN}', 400),
        (b'{"x": 1, "x": 2}', 400),
        (b'{"x": "1"}', 422),
        (b'{"x": true}', 422),
        (b'{"y": 1}', 422),
        (b"{}", 422),
        (b"[1]", 422),
        (b'{"x": 1' + b" " * 1024 + b"}", 413),
    ],
)
def test_line_that_is_not_valid_ends_the_stream(
    served: Served, client: httpx.Client, line: bytes, status: int
) -> None:
    """An invalid line is neither clamped nor skipped: the stream ends with an error."""
    answer = client.post("stream", content=iter([b'{"x": 1.0}\n', line + b'\n{"x": 5.0}\n']))

    assert answer.status_code == status
    assert served.stage.setpoints == [{"x": 1.0}]


@pytest.mark.fault("C10")
def test_stream_that_goes_on_after_an_error_is_cut_off(served: Served) -> None:
    """The error is sent while the body is still arriving, and closes the connection."""
    with connected(served.socket) as connection:
        connection.sendall(CHUNKED + _chunk(b'{"x": 1.0}\n{"x": "2"}\n'))
        answer = read_to_end(connection)

    assert answer.startswith(b"HTTP/1.1 422")
    assert b"connection: close" in answer


@pytest.mark.fault("C13")
def test_stage_that_does_not_follow_refuses(served: Served, client: httpx.Client) -> None:
    """If the state does not allow a stream, its first line is answered with 409."""
    served.stage.refusal = "the stage is SAFE; arm it first"
    answer = client.post("stream", content=b'{"x": 1.0}\n')

    assert (answer.status_code, served.stage.setpoints) == (409, [])


@pytest.mark.fault("C13")
def test_stage_that_stops_following_ends_the_stream(served: Served, client: httpx.Client) -> None:
    """A stream that the stage no longer follows ends with the reason."""
    served.stage.stream_refusal = "the stage is HOLD"
    answer = client.post("stream", content=b'{"x": 1.0}\n{"x": 2.0}\n')

    assert answer.json()["error"]["what"] == "the stage is HOLD"


@pytest.mark.fault("C8")
def test_stream_needs_the_lease_at_each_line(served: Served) -> None:
    """A stream ends when another client takes the lease."""

    def lines() -> Iterator[bytes]:
        yield b'{"x": 1.0}\n'
        eventually(lambda: served.stage.setpoints)
        with served.client("first") as again, served.client("second") as second:
            again.delete("lease")
            second.post("lease").raise_for_status()
        yield b'{"x": 2.0}\n'

    with served.client("first") as first:
        answer = first.post("stream", content=lines())

    assert (answer.status_code, answer.json()["error"]["code"]) == (409, "lease_held")
    assert served.stage.setpoints == [{"x": 1.0}]


@pytest.mark.fault("C9")
def test_client_that_goes_away_loses_the_lease_soon(served: Served) -> None:
    """The lease of a disconnected client expires after 2 s, and the audit has the end."""
    with connected(served.socket) as connection:
        connection.sendall(CHUNKED + _chunk(b'{"x": 1.0}\n'))
        eventually(lambda: served.stage.setpoints)
    eventually(lambda: len(served.stage.audited) == 2)
    with served.client("second") as second:
        before = second.post("arm").status_code
        served.now.now_s += 2.0
        after = second.post("arm").status_code

    assert (before, after) == (409, 200)
    note = served.stage.audited[1]
    assert (note.what, note.why) == ("stream ended after 1 setpoints", "the client disconnected")
    assert note.peer.uid == os.getuid()


@pytest.mark.fault("C8")
@pytest.mark.parametrize(
    ("path", "body", "what"),
    [
        ("goto", {"axis": "x", "position_um": 5.0}, "goto of somebody has taken over x"),
        ("follow", {}, "follow of somebody has taken over x, y"),
        ("resume", {}, "resume of somebody has taken over x, y"),
    ],
)
def test_request_that_takes_over_an_axis_ends_its_stream(
    served: Served, path: str, body: dict[str, object], what: str
) -> None:
    """A stream is refused further setpoints when the same client commands the axis otherwise."""

    def lines() -> Iterator[bytes]:
        yield b'{"x": 1.0, "y": 1.0}\n'
        eventually(lambda: served.stage.setpoints)
        with served.client() as again:
            again.post(path, json=body).raise_for_status()
        yield b'{"x": 2.0, "y": 2.0}\n'

    with served.client() as client:
        answer = client.post("stream", content=lines())

    error = answer.json()["error"]
    assert (answer.status_code, error["code"], error["what"]) == (409, "superseded", what)
    assert served.stage.setpoints == [{"x": 1.0, "y": 1.0}]


@pytest.mark.fault("C8")
def test_one_axis_follows_one_stream(served: Served) -> None:
    """The newer of two streams on one axis goes on, and the older one is refused."""

    def older() -> Iterator[bytes]:
        yield b'{"x": 1.0, "y": 1.0}\n'
        eventually(lambda: served.stage.setpoints)
        with served.client() as again:
            newer = again.post("stream", content=b'{"y": 3.0}\n{"y": 4.0}\n')
            assert newer.json()["setpoints"] == 2
        yield b'{"x": 2.0}\n'

    with served.client() as client:
        answer = client.post("stream", content=older())

    assert answer.json()["error"]["what"] == "stream of somebody has taken over y"
    assert served.stage.setpoints == [{"x": 1.0, "y": 1.0}, {"y": 3.0}, {"y": 4.0}]


def test_stream_goes_on_beside_requests_for_other_axes(served: Served) -> None:
    """Neither a movement of another axis nor a refused request ends a stream."""

    def lines() -> Iterator[bytes]:
        yield b'{"x": 1.0}\n'
        eventually(lambda: served.stage.setpoints)
        with served.client() as again:
            again.post("goto", json={"axis": "y", "position_um": 5.0}).raise_for_status()
            again.post("mode", json={"mode": "adaptive"}).raise_for_status()
            served.stage.refusal = "out of range"
            assert again.post("goto", json={"axis": "x", "position_um": 5e3}).status_code == 409
        yield b'{"x": 2.0}\n'

    with served.client() as client:
        answer = client.post("stream", content=lines())

    assert answer.json() == {"accepted": True, "setpoints": 2}


@pytest.mark.fault("C4")
def test_silent_stream_is_ended(serve: Serve) -> None:
    """A stream without further setpoints is answered with an error."""
    served = serve(ConnectionLimits(message_s=0.2))
    with connected(served.socket) as connection:
        connection.sendall(CHUNKED + _chunk(b'{"x": 1.0}\n'))
        answer = connection.recv(65536)

    assert answer.startswith(b"HTTP/1.1 408")


def test_stream_ends_with_the_server(serve: Serve) -> None:
    """An open stream does not delay the end of the daemon."""
    served = serve(ConnectionLimits())
    with connected(served.socket) as connection:
        connection.sendall(CHUNKED + _chunk(b'{"x": 1.0}\n'))
        eventually(lambda: served.stage.setpoints)
        served.server.should_exit = True

        assert connection.recv(65536) == b""
