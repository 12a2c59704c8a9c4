"""A stage in the process of the test, with a loop without devices."""

import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor import loop_run as loop_supervision
from tests.daemon.daemons import configuration
from tests.daemon.fake_loop import start_fake_loop
from tests.daemon.supervisor.manager import listening
from tests.daemon.supervisor.run_rig import Rig


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    """Return a socket like that of systemd."""
    with listening(tmp_path) as listener:
        yield listener


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    """Return a stage whose loop and ramp-down use no device."""
    processes: list[tuple[str, Popen[bytes]]] = []
    safe_codes: list[int] = [0]
    loop_code: list[str] = []

    def started(module: str, *arguments: str, piped: bool = False) -> "Popen[bytes]":
        safe = [f"raise SystemExit({safe_codes[0]})"] if arguments[0] == "safe" else []
        pipe = PIPE if piped else None
        if code := safe or loop_code:
            process = Popen([sys.executable, "-c", *code], stdin=pipe, stdout=pipe)
        else:
            process = start_fake_loop(*arguments)
        processes.append((module, process))
        return process

    monkeypatch.setattr(loop_supervision, "_start", started)
    monkeypatch.chdir(tmp_path)  # a socket's path is short, and pytest's folders are not
    paths = StagePaths("rig", Path("runtime"), Path("state"))
    yield Rig(configuration(tmp_path), paths, processes, safe_codes, loop_code)
    for _, process in processes:
        if process.poll() is None:
            process.kill()
            process.wait()
