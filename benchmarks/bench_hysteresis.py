"""Cost of the mathematics: per sample over an array, per step from Python, and at the start.

Run it with `python benchmarks/bench_hysteresis.py`. All of it runs on one core, in several rounds
that alternate between the candidates; the medians are printed, beside a compiled sum of 38
classical play operators as the reference. The largest cost of a cycle, one step of the exact
inverse plus one of recursive least squares, is timed step by step, for its median and its worst.
The costs without a JIT, and with numba's reference counting, are measured in separate processes.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter_ns
from typing import Any

from benchmarks.hysteresis_work import SAMPLES, arrays, command, cycle_steps, steps

ROOT = Path(__file__).parents[1]
ROUNDS = 7

STAND_IN = """
import sys, types
numba = types.ModuleType("numba")
numba.njit = lambda **_: lambda function: function
dispatcher = types.ModuleType("numba.core.dispatcher")
dispatcher.Dispatcher = type("Dispatcher", (), {})
for module in (numba, types.ModuleType("numba.core"), dispatcher):
    sys.modules[module.__name__] = module
"""
"""Replaces numba by a module that compiles nothing, before any import of it."""

START = """
import json, pathlib, re, time
start_ns = time.perf_counter_ns()
import numpy as np
from piezod.config.modes import Mode
from piezod.control.law.compensator import Compensator
from piezod.hysteresis import LMSIdentifier, MPIModel, StopForm, even_thresholds, new_bank
bank = new_bank(even_thresholds(19), even_thresholds(19))
MPIModel([0.5], [0.1], [0.1]).inverse().step(0.3)
model_ns = time.perf_counter_ns() - start_ns
lms = LMSIdentifier(bank)
compensator = Compensator(StopForm(bank), np.full(38, 0.01), mode=Mode.ADAPTIVE, fade_cycles=1)
lms.step(0.3, compensator.step(0.3, 0.0, 1.0, lms.weights))
loop_ns = time.perf_counter_ns() - start_ns
status = pathlib.Path("/proc/self/status").read_text()
peak_kb = int(re.search(r"VmHWM:\\s*(\\d+)", status)[1])  # that of this program alone
print(json.dumps([model_ns / 1e9, loop_ns / 1e9, peak_kb / 1024]))
"""


def interleaved_ns(runs: dict[str, Callable[[], object]], count: int) -> dict[str, float]:
    """Return the median duration of one of `count` samples in each run, in ns."""
    for run in runs.values():
        run()
    rounds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            start_ns = perf_counter_ns()
            run()
            rounds[name].append((perf_counter_ns() - start_ns) / count)
    return {name: median(times) for name, times in rounds.items()}


def each_us(step: Callable[[float], object], values: list[float]) -> list[float]:
    """Return the duration of each step, in µs."""
    step(values[0])
    durations = []
    for value in values:
        start_ns = perf_counter_ns()
        step(value)
        durations.append((perf_counter_ns() - start_ns) / 1000)
    return durations


def child(code: str, *arguments: str, **environment: str) -> Any:
    """Run Python in a new process with ordinary caches; return the JSON that it prints."""
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(  # noqa: S603 - our own programs
        [sys.executable, "-c", code, *arguments],
        env={**inherited, "PYTHONPATH": str(ROOT), **environment},
        stdout=subprocess.PIPE,
        check=True,
    )
    return json.loads(done.stdout)


def start(prologue: str = "", **environment: str) -> list[float]:
    """Return seconds to the first step of a model and of a loop, and peak memory in MB."""
    rounds = [child(prologue + START, **environment) for _ in range(ROUNDS)]
    return [median(column) for column in zip(*rounds[1:], strict=True)]


def without_jit() -> dict[str, float]:
    """Return the cost of steps of the same code without compilation, in ns."""
    code = """
import json
from benchmarks.bench_hysteresis import interleaved_ns, steps
print(json.dumps(interleaved_ns(steps(2000), 2000)))
"""
    return dict(child(STAND_IN + code))


def counting_references() -> dict[str, float]:
    """Return the cost per sample over an array with numba's memory runtime, in ns."""
    code = """
import json, piezod.jit
piezod.jit._OPTIONS["_nrt"] = True
from benchmarks.bench_hysteresis import SAMPLES, arrays, interleaved_ns
print(json.dumps(interleaved_ns(arrays(), SAMPLES)))
"""
    with tempfile.TemporaryDirectory() as folder:
        return dict(child(code, NUMBA_CACHE_DIR=folder))


def milliseconds(*command_line: str) -> float:
    """Return the median duration of a command, in ms."""
    times = []
    for _ in range(ROUNDS):
        start_ns = perf_counter_ns()
        subprocess.run(command_line, stdout=subprocess.DEVNULL, check=True)  # noqa: S603 - as above
        times.append((perf_counter_ns() - start_ns) / 1e6)
    return median(times[1:])


def print_arrays() -> None:
    """Measure and print the cost per sample of an array."""
    with_runtime = counting_references()
    costs = interleaved_ns(arrays(), SAMPLES)
    aims = {
        "forward, M = 19": 0.5,
        "forward, M = 200": 0.5,
        "exact inverse, M = 19": 0.5,
        "operators with LMS, M = 19": 2.0,
        "surface, forward": 1.0,
    }
    print(
        "Over an array, per sample                        ns   of reference   counting references"
    )
    for name, cost in costs.items():
        aim = f" (at most {aims[name]:g})" if name in aims else ""
        if name == "surface, inverse":
            aim = " (at most 500 ns)"
        row = f"{cost:8.1f}{cost / costs['reference']:10.2f}{with_runtime[name]:16.1f}"
        print(f"  {name + aim:<42}{row}")


def print_steps() -> None:
    """Measure and print the cost of a step that is called from Python."""
    compiled_us = {k: v / 1000 for k, v in interleaved_ns(steps(20_000), 20_000).items()}
    plain_us = {k: v / 1000 for k, v in without_jit().items()}
    aims = {"compensate and adapt": 2, "surface, compensate and adapt": 4}
    print("\nFrom Python, per step                            us    without a JIT")
    for name, cost in compiled_us.items():
        aim = f" (at most {aims[name]})" if name in aims else ""
        print(f"  {name + aim:<42}{cost:8.2f}{plain_us[name]:12.1f}")


def print_cycle() -> None:
    """Measure and print the median and the worst step of a cycle."""
    values = command(20_000).tolist()
    durations_us = {name: each_us(step, values) for name, step in cycle_steps().items()}
    reference_us = median(durations_us["reference"])
    print("\nFrom Python, each step by itself           median, us   of reference   worst, us")
    for name, each in durations_us.items():
        aim = " (at most 10)" if name == "exact inverse + RLS" else ""
        cost = median(each)
        print(f"  {name + aim:<38}{cost:13.2f}{cost / reference_us:15.2f}{max(each):12.1f}")


def print_starts() -> None:
    """Measure and print the cost of a start; caches are warm unless stated otherwise."""
    print("\nStart                        to a model's step, s   to a loop's step, s   peak MB")
    with tempfile.TemporaryDirectory() as folder:
        first = child(START, NUMBA_CACHE_DIR=folder)
    for name, figures in (
        ("with numba (at most 1)", start()),
        ("with numba, nothing cached", first),
        ("NUMBA_DISABLE_JIT=1", start(NUMBA_DISABLE_JIT="1")),
        ("without importing numba", start(STAND_IN)),
    ):
        print("  {:<32}{:12.2f}{:22.2f}{:15.0f}".format(name, *figures))
    empty = milliseconds(sys.executable, "-c", "pass")
    usage = milliseconds(str(Path(sys.executable).with_name("piezod")), "--help")
    print(f"\npiezod --help: {usage - empty:.0f} ms above python -c pass (at most 200)")


def main() -> None:
    """Measure and print."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print_arrays()
    print_steps()
    print_cycle()
    print_starts()


if __name__ == "__main__":
    main()
