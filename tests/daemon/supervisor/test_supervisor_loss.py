"""Loss of the loop or of its supervisor, with real processes."""

import os
import signal
import socket
from pathlib import Path

import pytest

from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import configuration, is_alive, latched
from tests.daemon.supervisor.manager import waiting
from tests.daemon.waiting import eventually


@pytest.mark.fault("L3")
def test_loop_that_hangs_is_killed_and_feeds_no_watchdog(
    start: StartDaemon, rig_file: Path, manager: socket.socket
) -> None:
    """A loop without cycles gets no watchdog fed, and the supervisor kills it."""
    manager.settimeout(90)
    environ = {"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "1000000"}
    daemon = start(rig_file, **environ)
    while not manager.recv(1000).startswith(b"READY=1"):
        pass
    assert manager.recv(1000).startswith((b"WATCHDOG=1", b"STATUS="))

    os.kill(daemon.loop_pid, signal.SIGSTOP)

    assert daemon.exit_code() == 1
    assert "loop killed" in daemon.text
    # Only messages from before it hung, until it was killed and the ramp-down began.
    until_killed, stopping, _ = waiting(manager).partition(b"STOPPING=1")
    assert stopping
    assert until_killed.count(b"WATCHDOG=1") < 10


@pytest.mark.fault("P2")
def test_loop_without_a_supervisor_goes_to_safe_and_ends(
    start: StartDaemon, tmp_path: Path
) -> None:
    """A loop whose supervisor was killed ramps down; the next start waits for it and latches P2.

    The ramp takes longer than a start.
    """
    config = configuration(tmp_path, safety="{safe_v: 0, ramp_v_per_s: 40}")
    daemon = start(config).up()
    daemon.driven(10.0, above_v=40.0)
    loop_pid = daemon.loop_pid

    daemon.process.kill()
    daemon.process.wait()
    daemon.start()
    status = daemon.until("FAULT", 90)

    assert not is_alive(loop_pid)
    assert latched(status) == ["P2"]
    assert daemon.ask("POST", "arm", {}).status_code == 409
    eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
    daemon.until("SAFE")
