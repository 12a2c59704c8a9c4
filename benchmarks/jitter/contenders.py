"""Programs for comparison: cyclictest, and a bare loop in C with the same pacing."""

import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SOURCE = Path(__file__).with_name("floor.c")
Nanoseconds = NDArray[np.int64]


class Pacing(NamedTuple):
    """Parameters of a run."""

    rate_hz: float  #: Cycles per second.
    seconds: int  #: Duration, in s.
    priority: int  #: Priority under SCHED_FIFO.
    cpu: int  #: Processor of the run.
    spin_ns: int  #: Time before a deadline at which spinning starts, in ns.

    @property
    def period_ns(self) -> int:
        """Period, in ns."""
        return round(1e9 / self.rate_hz)


class Lateness(NamedTuple):
    """Result of a run."""

    wake_ns: Nanoseconds  #: Lateness of each cycle at wake-up.
    write_ns: Nanoseconds  #: Lateness of each write; empty if nothing is written.
    skipped: int  #: Number of skipped periods.
    #: Duration of each cycle until the end of its write; empty for a bare loop.
    busy_ns: Nanoseconds


NOTHING: Nanoseconds = np.empty(0, np.int64)


def compile_floor(folder: Path) -> Path:
    """Compile the loop in C; return the path of the program.

    Raises:
        SystemExit: If there is no compiler.
    """
    if shutil.which("cc") is None:
        raise SystemExit("the floor needs a C compiler, `cc`: install gcc")
    program = folder / "floor"
    subprocess.run(["cc", "-O2", "-o", program, SOURCE], check=True)  # noqa: S603, S607 - our own
    return program


def floor(program: Path, pacing: Pacing) -> Lateness:
    """Run the loop in C."""
    period, spin = pacing.period_ns, pacing.spin_ns
    arguments = (period, spin, pacing.seconds, pacing.priority, pacing.cpu)
    text = _output([str(program), *map(str, arguments)])
    lines, _, skipped = text.rpartition("skipped")
    return Lateness(np.array(lines.split(), np.int64), NOTHING, int(skipped), NOTHING)


def cyclictest(pacing: Pacing) -> Lateness | None:
    """Run cyclictest, which sleeps until the deadline and does not spin; None without it."""
    if shutil.which("cyclictest") is None:
        return None
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        _output(
            [
                "cyclictest",
                *("-q", "-m", "-t1", f"-a{pacing.cpu}", f"-p{pacing.priority}", "--policy=fifo"),
                f"-i{pacing.period_ns // 1000}",
                *(f"-D{pacing.seconds}", "-h100000", f"--json={file.name}"),
            ]
        )
        [thread] = json.loads(Path(file.name).read_text(encoding="utf-8"))["thread"].values()
    counts = {int(us): count for us, count in thread["histogram"].items()}
    late_ns = np.repeat(np.array(list(counts), np.int64) * 1000, list(counts.values()))
    skipped = int(np.sum(late_ns // pacing.period_ns))
    return Lateness(late_ns, NOTHING, skipped, NOTHING)


def _output(command: list[str]) -> str:
    done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - these
    return done.stdout
