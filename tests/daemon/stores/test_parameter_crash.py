"""The parameter store under kills and power failures: old parameters or new ones, never half."""

import os
import random
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest

from piezod.daemon import durable
from piezod.daemon.stores.parameter_store import ParameterStore
from tests.daemon.disk_model import Folder, LoggingOs, Op, crash_states
from tests.daemon.stored import WHEN, parameters
from tests.forked import Piped


@contextmanager
def saver(folder: Path) -> Iterator[Piped]:
    """Run `tests.daemon.saver`, and wait for its end."""
    process = Piped((str(folder),), "tests.daemon.saver")
    with process.stdout:
        with process.stdin:
            yield process
        assert process.wait() == 0


def kill_while_saving(process: Piped, saves: int, further_s: float) -> int:
    """Save parameters in a process, and kill it after some saves and a moment.

    Returns:
        Number of the last acknowledged save; 0 if there was none.
    """
    lines = process.stdout
    process.stdin.write("save\n")
    process.stdin.flush()
    child = int(lines.readline())
    last = 0
    for _ in range(saves):
        last = int(lines.readline())
    end_s = time.perf_counter() + further_s
    while time.perf_counter() < end_s:  # spin, because a sleep is not exact enough
        pass
    os.kill(child, signal.SIGKILL)
    return max([last, *numbers_until_gone(lines)])


def numbers_until_gone(lines: IO[str]) -> list[int]:
    """Return the numbers that the killed process had still printed."""
    return [int(line) for line in iter(lines.readline, "gone\n")]


@pytest.mark.fault("P8")
@pytest.mark.parametrize("kills", [20, pytest.param(200, marks=pytest.mark.stress)])
def test_kills_at_random_moments(tmp_path: Path, kills: int) -> None:
    """After each kill the last acknowledged save is loaded, or the one in progress."""
    moments = random.Random(4)  # noqa: S311 - no secret
    last = 0
    with saver(tmp_path) as process:
        for _ in range(kills):
            number = kill_while_saving(process, moments.randrange(4), moments.uniform(0, 3e-3))
            last = max(last, number)
            loaded = ParameterStore(tmp_path, "rig 1").load()
            if last == 0 and loaded.document is None:
                continue
            assert loaded.document is not None
            assert loaded.rejected == ()
            assert loaded.document.sequence in (last, last + 1)
            assert loaded.document.axes == parameters(float(loaded.document.sequence))
            last = loaded.document.sequence


def log_of_a_save(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Folder, list[Op]]:
    """Save twice; return the folder after the first save, and the operations of the second."""
    store = ParameterStore(folder, "rig 1", lambda: WHEN)
    store.save(parameters(1.0), "ann")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    logging_os = LoggingOs()
    with monkeypatch.context() as patch:
        patch.setattr(durable, "os", logging_os)
        store.save(parameters(2.0), "ann")
    return before, logging_os.log


def zeros_found(before: Folder, log: list[Op], new_folder: Callable[[], Path]) -> set[float]:
    """Return the sensor zeros that a load may find after a power failure."""
    found = set()
    for state in crash_states(before, log):
        folder = new_folder()
        for name, content in state.items():
            (folder / name).write_bytes(content)
        document = ParameterStore(folder, "rig 1").load().document
        assert document is not None
        found.add(document.axes["x"].zero_um)
    return found


@pytest.fixture
def new_folder(tmp_path: Path) -> Callable[[], Path]:
    """Return a function that makes a new empty folder."""
    numbers = iter(range(10_000))

    def make() -> Path:
        folder = tmp_path / f"crash {next(numbers)}"
        folder.mkdir()
        return folder

    return make


@pytest.mark.fault("P8")
def test_name_follows_content_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A save writes, syncs the contents, renames, and syncs the folder, in this order."""
    _, log = log_of_a_save(tmp_path / "store", monkeypatch)

    assert [op.kind for op in log[:4]] == ["write", "sync", "rename", "sync-folder"]
    assert {op.kind for op in log[4:]} <= {"sync-folder"}


@pytest.mark.fault("P8")
def test_power_loss_at_each_step(
    tmp_path: Path, new_folder: Callable[[], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before a save returns, old or new parameters are found; after that only the new ones."""
    before, log = log_of_a_save(tmp_path / "store", monkeypatch)
    found = [zeros_found(before, log[:steps], new_folder) for steps in range(len(log) + 1)]

    assert found[:3] == [{1.0}, {1.0}, {1.0}]
    assert found[3] == {1.0, 2.0}
    assert found[4:] == [{2.0}] * (len(log) - 3)
