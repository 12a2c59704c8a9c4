"""A program by others moves a stage that is served as a GCS controller: pylablib."""

import re
from collections.abc import Iterator

import pytest

from piezod.client import StageClient
from tests.daemon.daemons import SHIPPED, Daemon
from tests.daemon.waiting import eventually
from tests.forked import forked
from tests.peers.peer import run_peer

pytestmark = pytest.mark.peers


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Return the TCP port of the shipped simulated stage."""
    with Daemon(SHIPPED) as daemon:
        daemon.up()
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.folder))
        with forked("gcs", "--port", "0") as process:
            match = re.match(r"GCS 2 at 127\.0\.0\.1:(\d+)", process.stdout.readline())
            assert match
            yield int(match[1])


def test_pylablib_moves_the_simulated_stage(port: int) -> None:
    """The client finds the axis and its limits, moves in closed loop, stops, and sees errors."""
    report = run_peer("gcs_client.py", str(port))

    assert report["id"].startswith("(c)2026 piezod, piezod simulated, ")
    assert report["axes"] == ["1"]
    assert report["servo"] == [False, True]
    assert report["limits"] == [0.0, 26.0]
    assert report["reached"] == pytest.approx([5.0, 12.5], abs=0.4)
    assert report["speed"] == 50.0
    assert report["moved by"] == 10.0
    assert 0.0 < report["voltage"] < 150.0
    assert report["after stop"] == pytest.approx(3.0, abs=0.4)
    assert report["errors"] == {"servo off": 5, "limits": 7, "stop": 10, "none": 0}


@pytest.mark.parametrize(("end", "error"), [("stop", {"error": 10}), ("close", {})])
def test_targets_that_wait_are_dropped(port: int, end: str, error: dict[str, int]) -> None:
    """A stop overtakes the targets that were sent before it; a closed connection moves nothing."""
    report = run_peer("gcs_queue_client.py", str(port), end)

    with StageClient() as stage:
        eventually(lambda: stage.status().lease is None)  # the server is done with the connection
        moved = stage.status().axes["x"].motion
    assert report == {"sent": report["sent"], **error}
    assert moved < report["sent"] / 2
