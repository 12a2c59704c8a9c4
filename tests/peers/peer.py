"""Runs programs by others, in their own virtual environment and process."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[2]
PYTHON: Final = ROOT / "build" / "peers" / "bin" / "python"
"""Interpreter of the environment that `make peers` sets up."""
CLIENTS: Final = Path(__file__).parent / "clients"
WITHIN_S: Final = 60.0


def run_peer(script: str, *arguments: str) -> Any:
    """Run a script of `clients/` with the libraries by others; return what it prints, as JSON."""
    command = [str(PYTHON), str(CLIENTS / script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WITHIN_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@contextmanager
def serving_peer(script: str, *arguments: str) -> Iterator[str]:
    """Run a server of `clients/` while the block runs; yield the first line that it prints."""
    command = [str(PYTHON), str(CLIENTS / script), *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as server:
        assert server.stdout is not None
        try:
            line = server.stdout.readline().strip()
            assert line, "the server has ended, see its errors above"
            yield line
        finally:
            server.kill()


def need_library(name: str) -> None:
    """Skip the test if the environment lacks a library, which needs a newer Python."""
    command = [str(PYTHON), "-c", f"import {name}"]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip(f"{name} is not in {PYTHON.parent.parent}: it needs Python 3.12 or newer")
