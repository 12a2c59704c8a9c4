"""A stage in the process of the test, with a loop without devices."""

import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

import pytest

from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor import loop_run, processes
from tests.daemon.daemons import configuration
from tests.daemon.fake_loop import start_fake_loop
from tests.daemon.fake_rescuer import FakeRescuer
from tests.daemon.supervisor.manager import listening
from tests.daemon.supervisor.run_rig import Rig


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    """Return a socket like that of systemd."""
    with listening(tmp_path) as listener:
        yield listener


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    """Return a stage whose loop and rescuer use no device."""
    loops: list[Popen[bytes]] = []
    left: list[str] = []
    loop_code: list[str] = []
    rescues: list[str] = []

    def started(_module: str, *arguments: str) -> "Popen[bytes]":
        if loop_code:
            process = Popen([sys.executable, "-c", *loop_code], stdin=PIPE, stdout=PIPE)
        else:
            process = start_fake_loop(*arguments)
        loops.append(process)
        return process

    def rescuer(*_arguments: Any) -> FakeRescuer:
        return FakeRescuer(rescues, left)

    monkeypatch.setattr(processes, "start", started)
    monkeypatch.setattr(loop_run, "Rescuer", rescuer)
    monkeypatch.chdir(tmp_path)  # a socket's path is short, and pytest's folders are not
    paths = StagePaths("rig", Path("runtime"), Path("state"))
    yield Rig(configuration(tmp_path), paths, loops, loop_code, rescues, left)
    for process in loops:
        if process.poll() is None:
            process.kill()
            process.wait()
