"""Large requests and second starts do not disturb a daemon at rest."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from piezod.daemon.loop.loop import SUPERVISOR_LOST_NS
from piezod.messages.endpoints import LARGE_BODY
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S
from tests.daemon.daemons import Daemon, configuration
from tests.daemon.service.raw import HEAD, connected, read_to_end

COUNT = 30
POLL_S = 0.005
BODY = (b'{"a": [' + b"0," * LARGE_BODY)[: LARGE_BODY - 3] + b"0]}"


class BeatMonitor(threading.Thread):
    """Counts how often in a row the same beat of the supervisor is seen.

    It counts looks, not time: if the machine pauses, the counting pauses too.
    """

    def __init__(self, loop_map: Path) -> None:
        super().__init__()
        self._most = 0
        self._words = attach(loop_map).words
        self._ended = threading.Event()

    def run(self) -> None:
        """Count until `end`."""
        count, before_ns = 0, 0
        while not self._ended.wait(POLL_S):
            beat_ns = self._words[Word.SUPERVISOR_BEAT_NS]
            count = count + 1 if beat_ns == before_ns else 0
            self._most, before_ns = max(self._most, count), beat_ns

    def end(self) -> int:
        """End the thread; return the highest count."""
        self._ended.set()
        self.join()
        return self._most


@pytest.fixture(scope="module")
def resting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """Return a disarmed daemon that all tests share."""
    with Daemon(configuration(tmp_path_factory.mktemp("resting"))) as daemon:
        yield daemon.up()


def send(path: Path, verb: str) -> bytes:
    """Send a large body; return the beginning of the answer, or nothing."""
    head = HEAD % verb.encode() + b"content-type: application/json\r\nconnection: close\r\n"
    with connected(path) as connection:
        with suppress(BrokenPipeError):  # the service need not read a body that it refuses
            connection.sendall(head + b"content-length: %d\r\n\r\n" % len(BODY) + BODY)
        return read_to_end(connection)[:12]


@pytest.mark.fault("C2")
def test_large_bodies_do_not_stop_the_beat(resting: Daemon) -> None:
    """All bodies are refused, and the beat never stops for long."""
    daemon = resting
    monitor = BeatMonitor(daemon.paths.loop_map)
    monitor.start()

    with ThreadPoolExecutor(COUNT // 2) as clients:
        paths, verbs = [daemon.paths.api_socket] * 2 * COUNT, ["estop"] * COUNT + ["wave"] * COUNT
        answers = set(clients.map(send, paths, verbs))

    assert monitor.end() * POLL_S < SUPERVISOR_LOST_NS / NS_PER_S / 2
    assert answers <= {b"HTTP/1.1 413", b"HTTP/1.1 422", b"HTTP/1.1 429", b""}
    assert daemon.status()["state"] == "SAFE"


@pytest.mark.fault("P9")
def test_second_start_leaves_the_first_alone(resting: Daemon) -> None:
    """Every further start ends with code 75 and changes nothing."""
    daemon = resting
    pid = daemon.loop_pid
    before = daemon.paths.api_socket.stat()
    lock = daemon.paths.lock.read_text()
    others = [daemon.another() for _ in range(2)]

    codes = [other.wait() for other in others]

    assert codes == [75, 75]
    assert daemon.until("SAFE")["stage"] == "rig"
    assert (daemon.loop_pid, daemon.paths.lock.read_text()) == (pid, lock)
    assert daemon.paths.api_socket.stat() == before
    assert daemon.paths.running.exists()
