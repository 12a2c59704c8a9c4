"""A stage in the process of the test, with a loop without devices."""

import sys
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor import loop_run as loop_supervision
from tests.daemon.daemons import configuration
from tests.daemon.supervisor.run_rig import Rig

FAKE = Path(__file__).parents[1] / "fake_loop.py"


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    """Return a stage whose loop and ramp-down use no device."""
    processes: list[tuple[str, Popen[bytes]]] = []
    safe_codes, loop_command = [0], [str(FAKE)]

    def started(module: str, *arguments: str, piped: bool = False) -> "Popen[bytes]":
        if arguments[0] == "safe":
            command = [sys.executable, "-c", f"raise SystemExit({safe_codes[0]})"]
        else:
            command = [sys.executable, *loop_command, *arguments]
        pipe = PIPE if piped else None
        process = Popen(command, stdin=pipe, stdout=pipe)
        processes.append((module, process))
        return process

    monkeypatch.setattr(loop_supervision, "_start", started)
    monkeypatch.chdir(tmp_path)  # a socket's path is short, and pytest's folders are not
    paths = StagePaths("rig", Path("runtime"), Path("state"))
    yield Rig(configuration(tmp_path), paths, processes, safe_codes, loop_command)
    for _, process in processes:
        if process.poll() is None:
            process.kill()
            process.wait()
