"""Many starts of one stage, and starts with other clocks."""

import os
import re
import shutil
import subprocess
import sys
from functools import partial
from math import ceil
from pathlib import Path

import pytest

from piezod.records.atomic import replacing
from tests.chaos.conftest import left_behind
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import Daemon, StartedDaemon, configuration
from tests.daemon.waiting import eventually

pytestmark = pytest.mark.chaos

STARTS = 50
SITE = """\
import pathlib, time
read = pathlib.Path({path!r}).read_text
clocks = time.time, time.time_ns
time.time = lambda: clocks[0]() + int(read())
time.time_ns = lambda: clocks[1]() + int(read()) * 10**9
"""
TWO_YEARS_S = 2 * 365 * 86400


@pytest.mark.fault("P9")
def test_one_of_many_parallel_starts_wins(start: StartDaemon, tmp_path: Path) -> None:
    """One start runs the stage; each of the others ends with code 75 and names the winner."""
    daemon = start(configuration(tmp_path))
    starts = [daemon.process, *(daemon.another() for _ in range(STARTS - 1))]
    eventually(lambda: sum(each.poll() is None for each in starts) == 1, 180.0)
    (winner,) = (each for each in starts if each.poll() is None)
    daemon.process = winner
    daemon.up()
    codes = [each.poll() for each in starts if each is not winner]
    named = re.findall(r"process (\d+)", daemon.text)

    daemon.do("shutdown")

    assert daemon.exit_code() == 0
    assert codes == [75] * (STARTS - 1)
    assert len(named) >= STARTS - 1
    assert left_behind(daemon) == []


@pytest.mark.parametrize("since_boot_s", [1, 10**8])
def test_stage_runs_whatever_the_monotonic_clock_shows(tmp_path: Path, since_boot_s: int) -> None:
    """A machine that has just booted, and one that has run for three years, make no difference.

    CLOCK_MONOTONIC and CLOCK_BOOTTIME are those of a time namespace.
    """
    unshare = shutil.which("unshare")
    if unshare is None or os.geteuid() != 0 or not Path("/proc/self/ns/time").exists():
        pytest.skip("a time namespace needs root, unshare and a kernel that has it")
    script = "\n".join(
        (
            "import time, sys",
            "from pathlib import Path",
            "from tests.daemon.daemons import Daemon",
            "print('clock', time.monotonic())",
            "with Daemon(Path(sys.argv[1])) as daemon:",
            "    daemon.up().driven(10.0, above_v=40.0)",
            "    daemon.do('shutdown')",
            "    print('code', daemon.exit_code())",
        )
    )
    now_s = float(Path("/proc/uptime").read_text(encoding="ascii").split()[0])
    offset = str(ceil(since_boot_s - now_s))
    command = [unshare, "--time", "--fork", f"--monotonic={offset}", f"--boottime={offset}"]
    command += [sys.executable, "-c", script, str(configuration(tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)

    assert done.returncode == 0, done.stderr
    assert "code 0" in done.stdout
    clock_s = float(done.stdout.split()[1])
    assert since_boot_s <= clock_s < since_boot_s + 100


@pytest.mark.fault("L4")
def test_wall_clock_that_is_set_moves_nothing(tmp_path: Path) -> None:
    """Steps of the wall clock by two years are reported as L4, and the stage stays in RUN.

    The wall clock is that of the daemon's processes: Python runs `sitecustomize` before all else.
    """
    shift = tmp_path / "shift"
    shift.write_text("0", encoding="ascii")
    (tmp_path / "sitecustomize.py").write_text(SITE.format(path=str(shift)), encoding="ascii")
    with StartedDaemon(configuration(tmp_path), PYTHONPATH=str(tmp_path)) as daemon:
        daemon.up()
        daemon.driven(10.0, above_v=40.0)
        for number, step_s in enumerate((TWO_YEARS_S, -TWO_YEARS_S), 1):
            # A process that reads half a number would step twice.
            with replacing(shift) as temporary:
                temporary.write_text(str(step_s), encoding="ascii")
            eventually(partial(_counted, daemon, number), 60.0)
            # A step while the one before is still present is no new detection.
            eventually(lambda: not _present(daemon), 60.0)
        state = daemon.status()["state"]
        daemon.do("shutdown")

        assert state == "RUN"
        assert daemon.exit_code() == 0, daemon.text
        assert left_behind(daemon) == []


def _counted(daemon: Daemon, number: int) -> bool:
    """Return whether L4 has been detected so often."""
    return f'fault_detections_total{{fault="L4",stage="rig"}} {number}.0' in _metrics(daemon)


def _present(daemon: Daemon) -> bool:
    """Return whether L4 is present."""
    return any(fault["id"] == "L4" for fault in daemon.status()["faults"])


def _metrics(daemon: Daemon) -> str:
    return daemon.ask("GET", "metrics").text
