"""A session: what a client starts ends with the client."""

import os

import pytest

from piezod.daemon.service.connection import ConnectionLimits
from piezod.daemon.service.long_answers import RETRY_S
from piezod.messages.stores import RunningRecording
from tests.daemon.service.conftest import Serve
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually

RUNNING = RunningRecording(True, "20261121T120000Z-mine", 1)


def kinds(served: Served) -> list[str]:
    """Return the requests that reached the stage."""
    return [request.kind for request in served.stage.requests]


@pytest.mark.fault("C15")
def test_lost_connection_stops_the_stage(served: Served) -> None:
    """When the connection closes, the stage is stopped and the lease is released."""
    with served.client("first") as first, served.client("second") as second:
        with first.stream("POST", "session", json={}) as answer:
            assert answer.status_code == 200
            first.post("arm").raise_for_status()
            served.now.now_s += 1000.0
            refused = second.post("arm")
        eventually(lambda: kinds(served) == ["arm", "stop"])
        eventually(lambda: second.post("arm").status_code == 200)

    assert (refused.status_code, refused.json()["error"]["code"]) == (409, "lease_held")
    assert "until its session ends" in refused.json()["error"]["what"]
    assert [each.what for each in served.stage.audited if "session" in each.what] == [
        "session begun",
        "session ended: stop",
    ]


def test_recording_of_the_client_is_ended(served: Served) -> None:
    """A recording that the process of the session has started ends with the session."""
    with served.client() as client, client.stream("POST", "session", json={}):
        client.post("recordings/start", json={"label": "mine"}).raise_for_status()
        served.stage.running = RUNNING
    eventually(lambda: served.stage.recordings_stopped == 1)


@pytest.mark.parametrize("other", [(os.getpid() + 1, "test"), (os.getpid(), "web")])
def test_recording_of_another_client_continues(served: Served, other: tuple[int, str]) -> None:
    """A recording of another process, or of another client of `piezod web`, is not ended."""
    with served.client() as client:
        client.post("recordings/start", json={"label": "mine"}).raise_for_status()
        served.stage.running = RUNNING
        served.app.state.service.recorders[RUNNING.name] = other
        with client.stream("POST", "session", json={}):
            pass
        eventually(lambda: client.post("arm").status_code == 200)
    eventually(lambda: served.stage.audited[-2].what == "session ended: stop")

    assert served.stage.recordings_stopped == 0


def test_stop_is_repeated_until_the_loop_takes_it(served: Served) -> None:
    """If no loop takes the stop, it is requested again."""
    with served.client() as client:
        with client.stream("POST", "session", json={}):
            served.stage.lost_link = True
        eventually(lambda: served.stage.unanswered > 1, 20 * RETRY_S)
        served.stage.lost_link = False

    eventually(lambda: kinds(served) == ["stop"])


def test_one_session_at_a_time(served: Served) -> None:
    """A second session is refused, also of a client with the same user and name."""
    with (
        served.client() as first,
        served.client() as second,
        first.stream("POST", "session", json={}),
    ):
        refused = second.post("session", json={})
        released = second.delete("lease").json()["released"]

    assert (refused.status_code, refused.json()["error"]["code"]) == (409, "lease_held")
    assert f"process {os.getpid()} has a session" in refused.json()["error"]["what"]
    assert not released
    eventually(lambda: kinds(served) == ["stop"])


def test_end_of_the_service_waits_for_no_stop(serve: Serve) -> None:
    """A daemon that ends has stopped the stage already."""
    served = serve(ConnectionLimits())
    with served.client() as client, client.stream("POST", "session", json={}) as answer:
        served.server.should_exit = True
        answer.read()

    assert kinds(served) == []
