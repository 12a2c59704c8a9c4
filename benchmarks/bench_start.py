"""What starting costs: processor time of commands and imports, and the memory of a daemon.

`python benchmarks/bench_start.py` prints each processor time beside that of `python -c pass` in the
same run, and the memory of supervisor and loop process of a simulated stage. Private memory is what
the process alone has; the proportional set size counts shared pages in proportion.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Final

from piezod.daemon.paths import stage_paths
from piezod.telemetry.shared_map import MapError, attach
from piezod.telemetry.words import Word

ROUNDS: Final = 7
UP_WITHIN_S: Final = 120.0
SIMULATED: Final = Path(__file__).parents[1] / "config" / "simulated.yaml"
PIEZOD: Final = (sys.executable, "-m", "piezod")
COMMANDS: Final = {
    "python -c pass": (sys.executable, "-c", "pass"),
    "import piezod.client": (sys.executable, "-c", "import piezod.client"),
    "piezod --version": (*PIEZOD, "--version"),
    "piezod status": (*PIEZOD, "status"),
}


def cpu_s(command: tuple[str, ...], environ: dict[str, str]) -> float:
    """Return the processor time of a command, in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environ, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - ours
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def memory_mb(pid: int) -> dict[str, float]:
    """Return resident, proportional and private memory of a process, in MB."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()[1:]
    kb = {name: int(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines)}
    private = kb["Private_Clean"] + kb["Private_Dirty"]
    return {
        "resident": kb["Rss"] / 1024,
        "proportional": kb["Pss"] / 1024,
        "private": private / 1024,
    }


def wait_until_up(environ: dict[str, str]) -> int:
    """Wait for the first healthy cycle of the stage; return the process id of its loop."""
    end_s = time.monotonic() + UP_WITHIN_S
    while time.monotonic() < end_s:
        try:
            words = attach(stage_paths(SIMULATED, environ).loop_map).words
            if words[Word.HEALTHY_CYCLES]:
                return words[Word.LOOP_PID]
        except (OSError, MapError):
            pass
        time.sleep(0.1)
    raise TimeoutError("the stage did not come up")


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory(prefix="pz-") as folder:
        environ = {**os.environ, "XDG_RUNTIME_DIR": folder, "XDG_STATE_HOME": folder}
        run = (*PIEZOD, "run", str(SIMULATED))
        daemon = subprocess.Popen(run, env=environ, stderr=subprocess.DEVNULL)  # noqa: S603 - ours
        try:
            loop_pid = wait_until_up(environ)
            memory = {"supervisor": memory_mb(daemon.pid), "loop process": memory_mb(loop_pid)}
            times_s: dict[str, list[float]] = {name: [] for name in COMMANDS}
            for _ in range(ROUNDS + 1):
                for name, command in COMMANDS.items():
                    times_s[name].append(cpu_s(command, environ))
            print(f"processor time, median of {ROUNDS}, and its ratio to python -c pass")
            floor_s = median(times_s["python -c pass"][1:])
            for name, each_s in times_s.items():
                middle_s = median(each_s[1:])  # the first one warms the caches
                print(f"  {name:22} {middle_s:.3f} s  {middle_s / floor_s:5.1f}")
            print("memory of a stage that has just come up, in MB")
            for name, each_mb in memory.items():
                figures = ", ".join(f"{what} {mb:.1f}" for what, mb in each_mb.items())
                print(f"  {name:22} {figures}")
        finally:
            daemon.terminate()
            daemon.wait()


if __name__ == "__main__":
    main()
