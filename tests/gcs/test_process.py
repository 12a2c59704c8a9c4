"""The server as a process, with a daemon that is killed."""

import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from tests.daemon.daemons import Daemon, configuration
from tests.daemon.waiting import eventually
from tests.forked import Piped, forked
from tests.gcs.gcs_client import GcsClient


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage, "rig"."""
    with Daemon(configuration(tmp_path)) as daemon:
        yield daemon.up()


def port_in(line: str) -> int:
    """Return the TCP port that the server prints."""
    match = re.match(r"GCS 2 at 127\.0\.0\.1:(\d+)", line)
    assert match, line
    return int(match[1])


def test_clients_move_a_stage_whose_daemon_is_killed(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One client moves, others read; after a kill of the daemon the connection goes on."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.folder))
    tty = daemon.folder / "stage.tty"
    with forked("gcs", "--port", "0", "--mode", "feedforward", "--pty", str(tty)) as process:
        port = port_in(process.stdout.readline())
        with GcsClient(port) as mover, GcsClient(port) as reader:
            assert mover.do("SVO 1 1") == 0
            assert mover.do("MOV 1 3") == 0
            eventually(lambda: mover.ask("\x05") == "0")
            assert mover.ask("ONT? 1") == "1=1"
            assert mover.ask("MOV? 1") == "1=3.000000"
            position_um = float(reader.ask("POS? 1").removeprefix("1="))
            assert position_um == pytest.approx(3.0, abs=1.0)
            assert reader.do("MOV 1 4") == 733
            with serial.Serial(str(tty), timeout=20) as line:
                line.write(b"SVO?\n")
                assert line.readline() == b"1=1\n"

            assert mover.do("\x18") == 10
            assert mover.do("MOV 1 2") == 0
            assert reader.do("STP") == 10
            assert mover.do("MOV 1 2") == 5
            assert daemon.status()["state"] == "HOLD"

            daemon.process.kill()
            daemon.process.wait()
            assert mover.do("SVO 1 1") == 215
            assert mover.ask("\x07") == "\xb0"
            daemon.start()
            eventually(lambda: daemon.status().get("state") == "FAULT", 60.0)
            assert mover.do("SVO 1 1") == 34
            eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
            daemon.ask("DELETE", "lease")
            eventually(lambda: mover.do("SVO 1 1") == 0, 20.0)
            assert mover.do("MOV 1 1") == 0
            assert daemon.ask("POST", "goto", {"position_um": 3.0}).status_code == 409

        eventually(lambda: daemon.ask("POST", "lease", {}).status_code == 200, 10.0)
        assert daemon.status()["state"] == "RUN"
        with GcsClient(port) as browser:
            browser.send(b"POST / HTTP/1.1\r\n\r\nSTP\n")
            assert browser.closed()
        assert daemon.status()["state"] == "RUN"
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    assert not tty.exists()
    daemon.do("stop")


def test_stop_and_leaving_drop_what_waits(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of some hundred movements that wait, few have begun when the stage stands."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(daemon.folder))
    moves = b"MOV 1 1\nMOV 1 2\n" * 150

    def moved() -> int:
        return int(daemon.status()["axes"]["x"]["motion"])

    with forked("gcs", "--port", "0", "--mode", "feedforward") as process:
        port = port_in(process.stdout.readline())
        with GcsClient(port) as client:
            assert client.do("SVO 1 1") == 0
            client.send(moves)
            assert client.do("\x18") == 10
            assert moved() < 150
            before = moved()
            client.send(moves)
            eventually(lambda: moved() > before)
        eventually(lambda: daemon.status()["lease"] is None, 10.0)
        assert moved() < before + 150
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    daemon.do("stop")


def test_no_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a daemon the command ends with 69."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))

    process = Piped(("gcs", "--port", "0"))
    with process.stdin, process.stdout:
        assert process.wait(20.0) == 69
