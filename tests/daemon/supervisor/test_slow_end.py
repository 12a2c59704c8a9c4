"""The end of a daemon whose files take long to write."""

import socket

import pytest

from piezod.daemon.stores.flight_recorder import FlightRecorder
from tests.daemon.supervisor.manager import waiting
from tests.daemon.supervisor.run_rig import Rig
from tests.daemon.waiting import eventually


@pytest.mark.fault("P1")
def test_slow_disk_at_the_end_does_not_starve_the_watchdog(
    rig: Rig, manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flight record that is still being written when the loop has ended delays the end only."""
    writes: list[object] = []
    fed: list[bytes] = []
    monkeypatch.setenv("NOTIFY_SOCKET", manager.getsockname())
    monkeypatch.setenv("WATCHDOG_USEC", "3000000")

    def write_slowly(*_: object) -> None:
        writes.append(None)
        if len(writes) == 1:
            eventually(lambda: not rig.paths.api_socket.exists())
            waiting(manager)
            fed.extend(manager.recv(1000) for _ in range(3))

    def until_it_writes() -> None:
        eventually(lambda: writes)

    monkeypatch.setattr(FlightRecorder, "is_due", lambda *_: not writes)
    monkeypatch.setattr(FlightRecorder, "write_now", write_slowly)
    in_order = rig.run(until_it_writes)

    assert in_order
    assert fed == [b"WATCHDOG=1"] * 3
