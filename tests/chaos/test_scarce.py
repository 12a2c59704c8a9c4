"""A full disk, and memory that another process takes."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.chaos.conftest import ChaosStage, left_behind
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import configuration, is_alive
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.chaos

GROUPS = Path("/sys/fs/cgroup/memory")
GROUP_MB = 100
HOG = """\
import sys, time
held = []
print("ready", flush=True)
sys.stdin.readline()
while True:
    held.append(bytearray(2**20))
"""


@contextmanager
def small_disk(path: Path, size: str) -> Iterator[Path]:
    """Mount a small file system while the block runs."""
    if os.geteuid() != 0:
        pytest.skip("to mount a small disk needs root")
    path.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size},mode=700", "piezod-chaos", str(path)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"a small disk cannot be mounted here: {done.stderr.strip()}")
    try:
        yield path
    finally:
        subprocess.run(["umount", "--lazy", str(path)], check=True)  # noqa: S607


def fill(path: Path) -> None:
    """Write a file until the disk is full."""
    with path.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))


@pytest.mark.fault("P6")
def test_stage_moves_on_while_its_disk_is_full(start: StartDaemon, tmp_path: Path) -> None:
    """Parameters and recordings are refused with the reason; the stage moves on, and ends in order.

    When there is room again, parameters are saved, and nothing half written is left.
    """
    with small_disk(tmp_path / "state", "8m") as disk:
        daemon = start(configuration(tmp_path), XDG_STATE_HOME=str(disk)).up()
        daemon.driven(10.0, above_v=40.0)
        fill(disk / "filler")
        saved = daemon.ask("POST", "params/save", {})
        recorded = daemon.ask("POST", "recordings/start", {})
        daemon.driven(5.0, above_v=10.0)
        daemon.do("estop")  # a fault, whose flight record has no room
        eventually(lambda: "flight recorder failed" in daemon.text, 60.0)
        daemon.until("FAULT")
        (disk / "filler").unlink()
        saved_later = daemon.ask("POST", "params/save", {})
        daemon.do("shutdown")
        code = daemon.exit_code()
        left = [each.name for each in disk.rglob("*") if ".tmp" in each.name]
        left += left_behind(daemon)

    assert saved.status_code >= 400
    assert "space" in saved.text
    assert recorded.status_code >= 400
    assert saved_later.status_code == 200, saved_later.text
    assert code == 0
    assert left == []


@pytest.mark.fault("P6")
def test_start_on_a_full_disk_drives_nothing(start: StartDaemon, tmp_path: Path) -> None:
    """The start names the file that has no room, and leaves no process; then it can be repeated."""
    with small_disk(tmp_path / "run", "16m") as disk:
        fill(disk / "filler")
        daemon = start(configuration(tmp_path), XDG_RUNTIME_DIR=str(disk))
        code = daemon.exit_code()
        text = daemon.text
        left = left_behind(daemon)
        (disk / "filler").unlink()
        daemon.start()
        daemon.up().do("shutdown")
        again = daemon.exit_code()

    assert code not in {0, -signal.SIGKILL}
    assert "No space left on device" in text
    assert str(disk) in text
    assert left == []
    assert again == 0


@contextmanager
def crowded(*pids: int) -> Iterator["subprocess.Popen[str]"]:
    """Yield a process that shares a little memory with others, and takes all of it on request."""
    group = GROUPS / f"piezod-chaos-{os.getpid()}"
    try:
        group.mkdir()
    except OSError as error:
        pytest.skip(f"a control group for memory needs root and cgroup v1: {error}")
    command = [sys.executable, "-c", HOG]
    hog = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert hog.stdout is not None
    try:
        hog.stdout.readline()
        (group / "memory.limit_in_bytes").write_text(f"{GROUP_MB}M", encoding="ascii")
        for pid in (*pids, hog.pid):
            (group / "cgroup.procs").write_text(str(pid), encoding="ascii")
        yield hog
    finally:
        hog.kill()
        hog.communicate()
        for each in (group / "cgroup.procs").read_text(encoding="ascii").split():
            (GROUPS / "cgroup.procs").write_text(each, encoding="ascii")
        eventually(lambda: not (group / "cgroup.procs").read_text(encoding="ascii"))
        group.rmdir()


def test_process_that_eats_all_memory_dies_first(stage: ChaosStage) -> None:
    """A process that takes all memory is killed; the stage beside it moves on."""
    stage.bring("RUN")
    supervisor = stage.daemon.process.pid
    with crowded(supervisor, stage.loop_pid) as hog:
        Path(f"/proc/{hog.pid}/oom_score_adj").write_text("1000", encoding="ascii")
        assert hog.stdin is not None
        hog.stdin.write("\n")
        hog.stdin.flush()
        code = hog.wait(120)
        stage.wait_for_writes(20)
        alive = is_alive(supervisor), is_alive(stage.loop_pid)
    stage.daemon.do("shutdown")

    assert code == -signal.SIGKILL
    assert alive == (True, True)
    assert stage.daemon.exit_code() == 0, stage.daemon.text
    stage.assert_ended()
