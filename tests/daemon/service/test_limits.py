import json
import re
import socket
import time
from contextlib import ExitStack

import httpx
import numpy as np
import pytest

from piezod.daemon.service.access import (
    BURST,
    CLIENT_BURST,
    CLIENT_RATE_HZ,
    TOTAL_BURST,
    TOTAL_RATE_HZ,
    RateLimit,
)
from piezod.daemon.service.connection import ConnectionLimits
from piezod.daemon.service.route import URGENT
from piezod.messages.endpoints import LARGE_BODY, SMALL_BODY, Role
from piezod.telemetry.arrays import record_dtype
from tests.conftest import Reaction
from tests.daemon.service.conftest import Serve
from tests.daemon.service.fakes import FakeNow, Served
from tests.daemon.service.raw import HEAD, connected, read_to_end, wait_for_hang_up
from tests.fault_promises import PROMISES

QUICK = ConnectionLimits(message_s=0.2, idle_s=1, blocked_s=0.2, per_user=16)
JSON_TYPE = {"content-type": "application/json"}


@pytest.mark.fault("C1")
def test_malformed_body_is_refused(served: Served, client: httpx.Client) -> None:
    """A body that is not strict JSON is answered with 400 and does not reach the stage."""
    answer = client.post("goto", content=b'{"position_um": NaN}', headers=JSON_TYPE)

    assert (answer.status_code, answer.json()["error"]["code"]) == (400, "bad_json")
    assert served.called() == 0


@pytest.mark.fault("C1")
def test_body_must_be_said_to_be_json(served: Served, client: httpx.Client) -> None:
    """A form of a web page is refused."""
    answer = client.post("goto", data={"position_um": "1.0"})

    assert (answer.status_code, answer.json()["error"]["code"]) == (415, "media_type")
    assert served.called() == 0


@pytest.mark.fault("C1")
def test_ten_malformed_requests_close_the_connection(served: Served) -> None:
    """The tenth malformed request within 10 s closes the connection."""
    with served.client() as client:
        closed = [
            client.post("goto", json={"position_um": "1"}).headers.get("connection") == "close"
            for _ in range(10)
        ]

    assert closed == [False] * 9 + [True]


@pytest.mark.fault("C1")
def test_data_that_is_not_http_gets_an_error_document(served: Served) -> None:
    """Data that is not HTTP is answered with an error document, then the connection ends."""
    with connected(served.socket) as connection:
        connection.sendall(b"hello\r\n\r\n")
        header, _, body = read_to_end(connection).partition(b"\r\n\r\n")

    assert header.startswith(b"HTTP/1.1 400")
    assert json.loads(body)["error"]["code"] == "bad_request"


@pytest.mark.fault("C2")
@pytest.mark.parametrize("verb", ["estop", "wave"])
def test_announced_body_that_is_too_large_is_refused(client: httpx.Client, verb: str) -> None:
    """A body whose announced length is too large is not read."""
    answer = client.post(verb, content=b" " * (LARGE_BODY + 1), headers=JSON_TYPE)

    assert (answer.status_code, answer.json()["error"]["code"]) == (413, "too_large")
    assert answer.headers["connection"] == "close"


@pytest.mark.fault("C2")
def test_commands_are_small(client: httpx.Client) -> None:
    """A body without waveform or model has at most 1 KiB."""
    codes = [
        client.post("estop", content=b"{}" + b" " * (size - 2), headers=JSON_TYPE).status_code
        for size in (SMALL_BODY, SMALL_BODY + 1)
    ]

    assert codes == [200, 413]


@pytest.mark.fault("C2")
def test_large_body_is_read_as_strictly_as_others(served: Served, client: httpx.Client) -> None:
    """Errors in a large body have their places, and a valid large body arrives unchanged."""
    points = {"kind": "points", "points": [[i / 1000, i / 1000] for i in range(2000)]}
    wave = {"command_um": {"x": points}, "duration_s": 1.0}
    wrong = [
        client.post("wave", json=body)
        for body in ({**wave, "duration_s": "1"}, {**wave, "other": 1}, {**points})
    ]
    good = client.post("wave", json=wave)

    assert [answer.status_code for answer in wrong] == [422] * 3
    assert wrong[0].json()["error"]["what"].startswith("duration_s: must be a number")
    assert good.status_code == 200, good.text
    assert len(served.stage.requests) == 1
    assert served.stage.requests[0].model_dump(mode="json")["duration_s"] == 1.0


@pytest.mark.fault("C5")
def test_refusals_of_urgent_requests_do_not_fill_the_audit(
    served: Served, client: httpx.Client
) -> None:
    """The audit of urgent requests is limited in rate, and counts the dropped entries."""
    served.roles.role = Role.VIEWER
    for _ in range(200):
        client.post("stop")
    noted = len(served.stage.audited)
    served.now.now_s += 10.0
    client.post("stop")

    assert noted == BURST
    last = served.stage.audited[-1]
    assert last.what == f"POST /v1/stop (after {200 - BURST:.0f} that are not noted)"
    assert not last.accepted


def _send_until_refused(connection: socket.socket, chunk: bytes, most: int) -> int:
    sent = 0
    try:
        while sent < most:
            connection.sendall(chunk)
            sent += len(chunk)
    except (BrokenPipeError, ConnectionResetError):
        pass
    return sent


@pytest.mark.fault("C2")
def test_body_without_end_is_cut_off(served: Served) -> None:
    """An endless body is cut off near the limit; other clients are served meanwhile."""
    chunk = b"10000\r\n" + b" " * 65536 + b"\r\n"
    with connected(served.socket) as connection, served.client() as client:
        connection.sendall(HEAD % b"goto" + b"transfer-encoding: chunked\r\n\r\n")
        sent = _send_until_refused(connection, chunk, 1 << 30)
        status = client.get("status").status_code

    assert sent < 4 * LARGE_BODY
    assert status == 200


@pytest.mark.fault("C2")
def test_header_without_end_is_cut_off(served: Served) -> None:
    """A header has at most 64 KiB."""
    with connected(served.socket) as connection:
        connection.sendall(HEAD % b"goto")
        sent = _send_until_refused(connection, b"x-a: " + b"a" * 1000 + b"\r\n", 1 << 24)

    assert sent < 1 << 20


@pytest.mark.fault("C3")
def test_clients_that_do_not_read_are_disconnected(serve: Serve) -> None:
    """Sixteen clients that do not read are disconnected and do not block others."""
    served = serve(QUICK)
    served.stage.reader.else_ = np.zeros(1, record_dtype(2))
    served.stage.more_faults = ["S" * 100_000]  # of which a socket holds only a few
    with ExitStack() as stack:
        connections = [stack.enter_context(connected(served.socket)) for _ in range(16)]
        for connection in connections:
            connection.sendall(b"GET /v1/telemetry?rate_hz=50 HTTP/1.1\r\nhost: piezod\r\n\r\n")
        for connection in connections:
            wait_for_hang_up(connection)
    with served.client() as client:
        assert client.get("status").status_code == 200


@pytest.mark.fault("C3")
def test_answers_that_are_not_read_are_dropped(serve: Serve) -> None:
    """A client that sends requests and reads no answer is disconnected."""
    served = serve(QUICK)
    with connected(served.socket) as connection:
        connection.sendall(b"GET /v1/openapi HTTP/1.1\r\nhost: piezod\r\n\r\n" * 90)

        wait_for_hang_up(connection)


@pytest.mark.fault("C3")
@pytest.mark.parametrize("size", [1000, 240_000, 1_000_000])
def test_client_that_does_not_read_one_answer_is_disconnected(serve: Serve, size: int) -> None:
    """An unread answer is dropped after the time-out, whatever its size."""
    served = serve(QUICK)
    served.stage.configuration = {"title": "a" * size}
    with connected(served.socket) as connection:
        connection.sendall(b"GET /v1/config HTTP/1.1\r\nhost: piezod\r\n\r\n")

        wait_for_hang_up(connection)


@pytest.mark.fault("C4")
@pytest.mark.parametrize(
    "beginning",
    [b"POST /v1/go", HEAD % b"goto" + b"content-length: 10\r\n\r\n{"],
    ids=["header", "body"],
)
def test_request_that_does_not_arrive_is_given_up(serve: Serve, beginning: bytes) -> None:
    """An incomplete request is aborted after the time-out."""
    served = serve(QUICK)
    with connected(served.socket) as connection:
        connection.sendall(beginning)

        assert read_to_end(connection) == b""


@pytest.mark.fault("C4")
def test_body_after_the_answer_is_given_up(serve: Serve) -> None:
    """A body must also be complete after its answer."""
    served = serve(QUICK)
    with connected(served.socket) as connection:
        head = b"GET /v1/status HTTP/1.1\r\nhost: piezod\r\ncontent-length: 10\r\n\r\n"
        connection.sendall(head)

        assert read_to_end(connection).startswith(b"HTTP/1.1 200")


@pytest.mark.fault("C4")
@pytest.mark.parametrize("first", [b"", b"GET /v1/status HTTP/1.1\r\nhost: piezod\r\n\r\n"])
def test_idle_connection_is_closed(serve: Serve, first: bytes) -> None:
    """An idle connection is closed, also one without any request."""
    served = serve(QUICK)
    with connected(served.socket) as connection:
        connection.sendall(first)

        assert bool(read_to_end(connection)) == bool(first)


@pytest.mark.fault("C3")
@pytest.mark.fault("C4")
def test_slow_clients_are_disconnected_in_the_promised_time(
    serve: Serve, reaction: Reaction
) -> None:
    """Both at once, with the limits of a daemon: an unread answer, and a request in part."""
    served = serve(ConnectionLimits())
    served.stage.configuration = {"title": "a" * 1_000_000}
    with connected(served.socket) as reader, connected(served.socket) as writer:
        began_s = time.monotonic()
        reader.sendall(b"GET /v1/config HTTP/1.1\r\nhost: piezod\r\n\r\n")
        writer.sendall(b"POST /v1/go")
        wait_for_hang_up(writer)
        reaction("C4", ms=(time.monotonic() - began_s) * 1e3)
        wait_for_hang_up(reader)
        reaction("C3", ms=(time.monotonic() - began_s) * 1e3)


@pytest.mark.fault("C5")
def test_promise_names_the_limits_of_a_daemon() -> None:
    """Rates and times of the promise are those of the code."""
    limits = ConnectionLimits()

    numbers = re.findall(r"\d+", PROMISES["C5"].what)
    shown = [429, CLIENT_RATE_HZ, TOTAL_RATE_HZ, limits.idle_s, limits.fresh_s, limits.per_user]
    assert [float(number) for number in numbers] == shown


@pytest.mark.fault("C5")
def test_flood_is_refused_and_the_stage_can_be_stopped(
    served: Served, client: httpx.Client
) -> None:
    """After a burst requests get 429, except those towards safety."""
    burst = int(CLIENT_BURST)
    codes = [client.get("status").status_code for _ in range(burst + 50)]
    urgent = [client.request(method, path[4:]).status_code for method, path in sorted(URGENT)]

    assert codes == [200] * burst + [429] * 50
    assert urgent == [200] * 4
    assert {type(request).__name__ for request in served.stage.requests} == {
        "Disarm",
        "Estop",
        "Hold",
        "Stop",
    }


@pytest.mark.fault("C5")
def test_flood_may_go_on_slowly(served: Served, client: httpx.Client) -> None:
    """One second later fifty more requests are admitted."""
    codes = [client.get("status").status_code for _ in range(int(CLIENT_BURST) + 1)]
    served.now.now_s += 1.0
    later = [client.get("status").status_code for _ in range(51)]

    assert codes[-1] == 429
    assert later == [200] * 50 + [429]


@pytest.mark.fault("C5")
def test_unknown_paths_count(client: httpx.Client) -> None:
    """Requests to unknown paths count for the limit."""
    codes = {client.get("nothing").status_code for _ in range(int(CLIENT_BURST) + 1)}

    assert codes == {404, 429}


@pytest.mark.fault("C5")
def test_all_clients_together_are_limited() -> None:
    """All processes together get the total only; refused requests do not count for it."""
    limit = RateLimit(FakeNow())
    first = sum(limit.admit("first") for _ in range(10_000))
    others = sum(limit.admit(number) for number in range(1000) for _ in range(2))

    assert first == CLIENT_BURST
    assert others == TOTAL_BURST - CLIENT_BURST


@pytest.mark.fault("C5")
def test_clients_are_forgotten_when_they_have_paused() -> None:
    """The number of known clients is bounded; further clients are refused."""
    now = FakeNow()
    limit = RateLimit(now)
    for number in range(1024):
        limit.admit(number)
    refused = limit.admit("late")
    now.now_s += 10.0

    assert not refused
    assert limit.admit("later")


@pytest.mark.fault("C5")
def test_user_with_too_many_connections_can_stop_the_stage(serve: Serve) -> None:
    """Connections beyond the limit can only stop; beyond twice the limit the oldest one ends."""
    served = serve(QUICK._replace(per_user=2, idle_s=60, fresh_s=60.0))
    with ExitStack() as stack:
        clients = [stack.enter_context(served.client()) for _ in range(6)]
        status = [client.get("status").status_code for client in clients]
        stop = clients[5].post("stop").status_code

    assert status == [200, 200, 429, 429, 429, 429]
    assert stop == 200


@pytest.mark.fault("C5")
def test_idle_connections_make_room(serve: Serve) -> None:
    """Forty idle connections of a user keep none of its requests from being served."""
    served = serve(QUICK._replace(idle_s=60, fresh_s=0.0))
    with ExitStack() as stack:
        for _ in range(40):
            stack.enter_context(connected(served.socket))
        client = stack.enter_context(served.client())
        codes = [client.get("status").status_code, client.post("estop").status_code]

    assert codes == [200, 200]


@pytest.mark.fault("C5")
def test_connections_in_use_leave_room_for_an_emergency_stop(serve: Serve) -> None:
    """If no connection is idle, a new one can still stop the stage."""
    served = serve(QUICK._replace(message_s=60.0, idle_s=60))
    with ExitStack() as stack:
        for _ in range(40):
            connection = stack.enter_context(connected(served.socket))
            connection.sendall(HEAD % b"goto")
        codes = []
        for _ in range(3):
            with served.client() as client:
                codes.append(client.post("estop").status_code)

    assert codes == [200] * 3
