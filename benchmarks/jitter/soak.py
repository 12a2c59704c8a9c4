"""Watches the memory of the loop over time: `python -m benchmarks.jitter.soak [SECONDS]`.

Runs piezod's daemon at 1 kHz under the load of the benchmark, for ten minutes by default, and
prints the counters of the loop since it became real-time: page faults, garbage collections, memory
blocks. None of them should grow.
"""

import os
import sys
import time

from benchmarks.jitter.contenders import Pacing
from benchmarks.jitter.stage import running

LINES = 10


def main(seconds: int) -> None:
    """Run and print."""
    pacing = Pacing(1000.0, seconds, 60, max(os.sched_getaffinity(0)), 40_000)
    with running(pacing) as stage, stage.loaded():
        stage.measure(1.0)
        for line in range(LINES + 1):
            if line:
                time.sleep(seconds / LINES)
            counted = ", ".join(f"{name} {count}" for name, count in stage.counters.items())
            print(f"{line * seconds / LINES:7.1f} s: {counted}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 600)
