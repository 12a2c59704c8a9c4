"""One daemon for each stage."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from piezod.cli.exit_codes import exit_code
from piezod.daemon.lock import Lock
from piezod.errors import AlreadyRunningError

HOLD = """
import sys
from pathlib import Path
from piezod.daemon.lock import Lock
with Lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.fault("P9")
def test_lock_that_another_process_holds_is_refused(tmp_path: Path) -> None:
    """The error names the holder and has exit code 75."""
    path = tmp_path / "lock"
    command = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        with pytest.raises(AlreadyRunningError, match=f"as process {holder.pid};") as caught:
            Lock(path)

    assert exit_code(caught.value) == 75


def test_released_lock_can_be_taken(tmp_path: Path) -> None:
    """The file stays, with the process id of the present holder."""
    path = tmp_path / "lock"
    path.write_text("987654321\n")
    with Lock(path):
        pass

    with Lock(path):
        assert path.read_text() == f"{os.getpid()}\n"


def test_child_does_not_keep_the_lock(tmp_path: Path) -> None:
    """A child of the holder does not inherit the lock."""
    path = tmp_path / "lock"
    lock = Lock(path)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE):
        lock.release()

        Lock(path).release()


def test_link_is_not_followed(tmp_path: Path) -> None:
    """The process id is never written into the target of a link."""
    (tmp_path / "lock").symlink_to(tmp_path / "other")

    with pytest.raises(OSError, match="symbolic link"):
        Lock(tmp_path / "lock")

    assert not (tmp_path / "other").exists()
