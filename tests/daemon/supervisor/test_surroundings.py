"""A stage that has lost what is around it: it goes on, and `piezod stop` ends at the safe voltage."""

import os
import pty
import shutil
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

import piezod
import piezod_drivers
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import Daemon, StartedDaemon, configuration, is_alive
from tests.daemon.waiting import eventually

DRIVEN_V = 40.0


def driven(daemon: Daemon) -> Daemon:
    """Bring a stage to a position that needs a voltage."""
    daemon.up().driven(10.0, above_v=DRIVEN_V)
    return daemon


def assert_stops(daemon: Daemon) -> None:
    """Assert that the command line brings it to SAFE at the safe voltage, and that it runs on."""

    def stopped() -> bool:
        return daemon.command("stop", "--stage", "rig").returncode == 0

    eventually(stopped)
    socket = next(
        path for path in (daemon.paths.api_socket, daemon.paths.spare_socket) if path.exists()
    )

    def status() -> str:
        return daemon.command("status", "--socket", str(socket), "--json").stdout

    eventually(lambda: '"state": "SAFE"' in status(), 60.0)
    assert abs(_drive_v(status())) < 1.0
    assert daemon.process.poll() is None


def _drive_v(status: str) -> float:
    import json

    found: float = json.loads(status)["axes"]["x"]["drive_v"]
    return found


def separate(tmp_path: Path, start: StartDaemon, **environ: str) -> Daemon:
    """Start a stage whose state folder is not its runtime folder."""
    home = tmp_path / "home"
    home.mkdir()
    return driven(start(configuration(tmp_path), XDG_STATE_HOME=str(home), **environ))


def test_runtime_folder_is_made_again(start: StartDaemon, tmp_path: Path) -> None:
    """Socket, identities and the copy of the configuration are there again."""
    daemon = separate(tmp_path, start)
    eventually(daemon.paths.identities.exists)
    before = daemon.paths.identities.read_bytes()
    copy = daemon.paths.runtime / "config-a" / "rig.yaml"
    daemon.status()
    eventually(lambda: daemon.paths.spare_socket.exists())
    shutil.rmtree(daemon.paths.runtime)

    assert_stops(daemon)
    eventually(daemon.paths.api_socket.exists)
    eventually(lambda: daemon.paths.identities.exists() and copy.exists())
    assert daemon.paths.identities.read_bytes() == before
    assert daemon.status()["state"] == "SAFE"


def test_runtime_folder_that_nobody_can_make_again(start: StartDaemon, tmp_path: Path) -> None:
    """The socket beside the lock serves in its place."""
    daemon = separate(tmp_path, start)
    folder = daemon.paths.runtime.parent
    shutil.rmtree(folder)
    folder.touch()  # not even root makes a folder in a file

    assert_stops(daemon)
    assert not daemon.paths.api_socket.exists()


def test_state_folder_is_gone(start: StartDaemon, tmp_path: Path) -> None:
    """Nothing can be stored any more, as on a home folder without its server; the stage stops."""
    daemon = separate(tmp_path, start)
    home = tmp_path / "home"
    home.rename(tmp_path / "home.old")
    home.touch()

    assert_stops(daemon)


def test_no_socket_is_left(start: StartDaemon, tmp_path: Path) -> None:
    """The process is named, never called ended; a stop is a signal to it."""
    daemon = separate(tmp_path, start)
    folder, state = daemon.paths.runtime.parent, daemon.paths.state
    shutil.rmtree(folder)
    folder.touch()
    daemon.paths.spare_socket.unlink()
    daemon.paths.spare_socket.mkdir()  # nobody can bind a socket here
    status = daemon.command("status", "--stage", "rig")
    any_status = daemon.command("status")

    stopped = daemon.command("stop", "--stage", "rig")

    assert status.returncode == any_status.returncode == 69
    assert f"process {daemon.process.pid}" in status.stderr
    assert f"process {daemon.process.pid}" in any_status.stderr
    assert stopped.returncode == 0, stopped.stderr
    assert daemon.exit_code() == 0, daemon.text
    assert not (state / "running").exists()


class OnTerminal(StartedDaemon):
    """A daemon on a terminal of its own."""

    def another(self) -> Any:
        """Start `piezod run`; `master` is the other end of its terminal."""
        pid, self.master = pty.fork()
        if pid == 0:
            command = (sys.executable, "-m", "piezod", "run", str(self.config))
            os.execve(sys.executable, command, self.environ)
        self.log.touch()
        return _Pid(pid)


class _Pid:
    """A child process by its number."""

    def __init__(self, pid: int) -> None:
        self.pid, self._code = pid, None

    def poll(self) -> int | None:
        if self._code is None:
            done, status = os.waitpid(self.pid, os.WNOHANG)
            self._code = os.waitstatus_to_exitcode(status) if done else None
        return self._code

    def wait(self, within_s: float = 90.0) -> int:
        return int(eventually(lambda: (self.poll() is not None, self.poll()), within_s)[1])

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)
