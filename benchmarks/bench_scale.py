"""How much one machine carries, and where it breaks: axes, stages, and clients that stream.

`python benchmarks/bench_scale.py` runs daemons on the simulated rig that follow a sine adaptively.
It prints the share of skipped periods and the time of a cycle for one stage with 1 and 8 axes at
growing rates, for 1 to 8 stages at 1 kHz that share the processors, and for one stage with 1 to 20
clients of one user, of which each gets 50 messages a second. A row that is not in RUN all the time,
skips more than 1 %, or gets less than 90 % of its messages, is broken: larger ones are not tried.
`--compiled` takes the build of `make compiled`; `--seconds` is the duration of each run.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.jitter.contenders import Lateness, Pacing
from benchmarks.jitter.load import STREAM_HZ
from benchmarks.jitter.stage import COMPILED, REPOSITORY, Stage, running
from piezod.errors import ClientError

RATES_HZ: Final = (1000, 2000, 5000, 10_000, 20_000)
AXES: Final = (1, 8)
STAGES: Final = (1, 2, 4, 8)
CLIENTS: Final = (1, 5, 15, 20)
MOST_SKIPPED: Final = 0.01
LEAST_SERVED: Final = 0.9
PRIORITY: Final = 60


class Scale:
    """The runs of one build.

    Args:
        build: Folder of the build; None for the one that runs here.
        seconds: Duration of each run.
    """

    def __init__(self, build: Path | None, seconds: int) -> None:
        self._build, self._seconds = build, seconds
        self._cpus = sorted(os.sched_getaffinity(0))

    def axes(self, axes: int) -> None:
        """Raise the rate of one stage until it breaks."""
        for rate_hz in RATES_HZ:
            with running(self._pacing(rate_hz, 0), axes=axes, build=self._build) as stage:
                if not self._holds(f"{axes} axes, {rate_hz} Hz", [stage]):
                    return

    def stages(self) -> None:
        """Add stages at 1 kHz until one breaks."""
        for count in STAGES:
            with ExitStack() as stack:
                stages = [
                    stack.enter_context(running(self._pacing(1000, i), build=self._build))
                    for i in range(count)
                ]
                if not self._holds(f"{count} stages, 1000 Hz", stages):
                    return

    def clients(self) -> None:
        """Add clients that stream until the loop or the messages break."""
        with running(self._pacing(1000, 0), build=self._build) as stage:
            for count in CLIENTS:
                with streaming(stage, count) as received_hz:
                    holds = self._holds(f"{count} clients", [stage])
                served = received_hz() / (count * STREAM_HZ)
                print(f"    {100 * served:.0f} % of {STREAM_HZ} messages a second", flush=True)
                if not holds or served < LEAST_SERVED:
                    return

    def _pacing(self, rate_hz: float, index: int) -> Pacing:
        spin_ns = round(min(40e3, 0.3e9 / rate_hz))
        cpu = self._cpus[-1 - index % len(self._cpus)]
        return Pacing(rate_hz, self._seconds, PRIORITY, cpu, spin_ns)

    def _holds(self, name: str, stages: list[Stage]) -> bool:
        """Measure stages side by side and print; return whether all of them hold."""
        try:
            with ThreadPoolExecutor(len(stages)) as threads:
                runs = list(threads.map(lambda stage: stage.measure(self._seconds), stages))
        except ClientError as error:
            print(f"  {name:24} broken: {error}", flush=True)
            return False
        skipped = max(map(_skipped_share, runs))
        busy_us = np.percentile(np.concatenate([run.busy_ns for run in runs]), [50, 99]) / 1000
        left = "; ".join(text for stage in stages for text in stage.left_run)
        broken = left or ("skips too much" if skipped > MOST_SKIPPED else "")
        print(
            f"  {name:24} skipped {100 * skipped:7.3f} %  cycle {busy_us[0]:6.1f} µs, "
            f"p99 {busy_us[1]:6.1f} µs  {broken and f'broken: {broken}'}",
            flush=True,
        )
        return not broken


def _skipped_share(run: Lateness) -> float:
    return run.skipped / (run.wake_ns.size + run.skipped)


@contextmanager
def streaming(stage: Stage, count: int) -> Iterator[Callable[[], float]]:
    """Let clients stream meanwhile; afterwards the result tells their messages per second."""
    what = str(stage.socket), f"streams:{count}"
    command = [sys.executable, "-m", "benchmarks.jitter.load", *what]
    told: list[str] = []
    with subprocess.Popen(  # noqa: S603 - our own module
        command, cwd=REPOSITORY, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        if process.stdin is None or process.stdout is None:
            raise OSError("no pipes")
        process.stdout.readline()  # "ready"
        yield lambda: float(json.loads(told[0])["telemetry_hz"])
        process.stdin.close()
        told.append(process.stdout.read())


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--compiled", action="store_true")
    parser.add_argument("--seconds", type=int, default=5)
    asked = parser.parse_args()
    scale = Scale(COMPILED if asked.compiled else None, asked.seconds)
    for axes in AXES:
        scale.axes(axes)
    scale.stages()
    scale.clients()


if __name__ == "__main__":
    main()
