"""A stage loses what is around it: it goes on, and `piezod stop` ends at the safe voltage."""

import fcntl
import json
import os
import pty
import shutil
import signal
import sys
import termios
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

import piezod
import piezod_drivers
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import Daemon, StartedDaemon, configuration
from tests.daemon.waiting import eventually
from tests.hosted_rig import hosted, writes

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
    found: float = json.loads(status)["axes"]["x"]["drive_v"]
    return found


def separate(tmp_path: Path, start: StartDaemon, **environ: str) -> Daemon:
    """Start a stage whose state folder is not its runtime folder."""
    home = tmp_path / "home"
    home.mkdir()
    return driven(start(configuration(tmp_path), XDG_STATE_HOME=str(home), **environ))


@pytest.mark.chaos
def test_runtime_folder_is_made_again(start: StartDaemon, tmp_path: Path) -> None:
    """Socket, identities and the copy of the configuration are there again."""
    daemon = separate(tmp_path, start)
    eventually(daemon.paths.identities.exists)
    before = daemon.paths.identities.read_bytes()
    copy = daemon.paths.runtime / "config-a" / "rig.yaml"
    daemon.status()
    eventually(daemon.paths.spare_socket.exists)
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
    """A daemon on a terminal of its own; `master` is the other end of the terminal."""

    def another(self) -> Any:
        """Start `piezod run`."""
        self.master, terminal = pty.openpty()
        command = (sys.executable, "-m", "piezod", "run", str(self.config))
        self.log.touch()
        try:
            return Popen(
                command,
                stdin=terminal,
                stdout=terminal,
                stderr=terminal,
                env=self.environ,
                start_new_session=True,
                preexec_fn=_take_terminal,  # noqa: PLW1509 - a system call, no lock
            )
        finally:
            os.close(terminal)


def _take_terminal() -> None:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def test_terminal_is_closed(tmp_path: Path) -> None:
    """Neither the signal of the terminal nor a log without a reader stops the stage."""
    with OnTerminal(configuration(tmp_path)) as daemon:
        driven(daemon)
        os.close(daemon.master)

        assert_stops(daemon)
        daemon.signal(signal.SIGTERM)
        assert daemon.exit_code() == 0


class Installed(StartedDaemon):
    """A daemon that runs from an installation of its own."""

    def __init__(self, config: Path, installation: Path) -> None:
        installation.mkdir()
        for package in (piezod, piezod_drivers):
            folder = Path(str(package.__file__)).parent
            (installation / folder.name).symlink_to(folder)
        for library in folder.parent.glob("*__mypyc*.so"):  # of a compiled build
            (installation / library.name).symlink_to(library)
        super().__init__(config, PYTHONPATH=str(installation))


def remove(installation: Path) -> None:
    """Remove an installation, and let nobody find another one."""
    for package in installation.iterdir():
        package.unlink()
        package.mkdir()
        (package / "__init__.py").touch()


def test_installation_is_replaced(tmp_path: Path) -> None:
    """A recording, metrics and telemetry need nothing of it; neither does the stop."""
    with Installed(configuration(tmp_path), tmp_path / "new") as daemon:
        driven(daemon)
        remove(tmp_path / "new")

        daemon.do("recordings/start")
        assert daemon.ask("GET", "metrics").status_code == 200
        daemon.do("recordings/stop")
        assert_stops(daemon)
        daemon.do("shutdown")
        assert daemon.exit_code() == 0, daemon.text


@pytest.mark.fault("P3")
def test_loop_dies_after_the_installation_was_replaced(tmp_path: Path) -> None:
    """The rescuer was there before, and brings the stage to its safe voltage."""
    with hosted(tmp_path / "rig.sock", tmp_path / "trace.csv"):
        rig = f"{{driver: emulated, options: {{socket: {tmp_path}/rig.sock, deadline_ms: 500}}}}"
        with Installed(configuration(tmp_path, rig=rig), tmp_path / "new") as daemon:
            driven(daemon)
            remove(tmp_path / "new")
            os.kill(daemon.loop_pid, signal.SIGKILL)

            assert daemon.exit_code() == 1, daemon.text
            assert "ramped down" in daemon.text
        assert writes(tmp_path / "trace.csv")[-1].drive_v == 0.0
