"""Lateness of piezod's loop, compared with the lower limit of this machine.

`python -m benchmarks.jitter` takes a minute, `--long` half an hour. Each round runs, one after the
other on the same processor at the same priority and period: cyclictest (which sleeps and does not
spin), a bare loop in C with piezod's pacing (the floor), and piezod's own daemon on the simulated
rig, armed and following a sine adaptively, once idle and once under load: telemetry streamed to
three clients, 200 requests a second, every cycle recorded to HDF5. Percentiles are over all rounds;
the change under load is computed pair by pair, and so is what is skipped beside the floor.
`--compiled` takes the build of `make compiled`. It needs root, or the limits of the service.
"""

import argparse
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.jitter.contenders import (
    Lateness,
    Nanoseconds,
    Pacing,
    compile_floor,
    cyclictest,
    floor,
)
from benchmarks.jitter.stage import COMPILED, running
from piezod.errors import ClientError

NAMES = ("cyclictest", "floor in C", "piezod", "piezod, loaded")
FLOOR, QUIET, LOADED = NAMES[1:]


class Rounds:
    """Results of all rounds at one rate."""

    def __init__(self, rate_hz: float, build: Path | None = None, *, loads: bool = True) -> None:
        self.rate_hz = rate_hz
        self._build, self._loads = build, loads
        self.runs: dict[str, list[Lateness]] = {name: [] for name in NAMES}
        self.pairs: list[tuple[Lateness, Lateness]] = []
        self.notes: list[str] = []
        self.left_run: list[str] = []

    def run(self, program: Path, pacing: Pacing) -> None:
        """Run every contender once."""
        if compared := cyclictest(pacing):
            self.runs["cyclictest"].append(compared)
        self.runs[FLOOR].append(floor(program, pacing))
        try:
            with running(pacing, build=self._build) as stage:
                quiet = stage.measure(pacing.seconds)
                self.runs[QUIET].append(quiet)
                load: Mapping[str, float] = {}
                if self._loads:
                    with stage.loaded() as load:
                        loaded = stage.measure(pacing.seconds)
                    self.runs[LOADED].append(loaded)
                    self.pairs.append((quiet, loaded))
                self._note(load, stage.counters, stage.report)
                self.left_run += stage.left_run
        except ClientError as error:
            self.notes.append(f"not armed: {error}")

    def _note(
        self, load: Mapping[str, float], counters: dict[str, int], report: list[dict[str, Any]]
    ) -> None:
        missing = [step["name"] for step in report if not step["ok"]]
        counted = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counters.items())
        loaded = ", ".join(f"{name} {amount:.0f}" for name, amount in load.items())
        self.notes = [
            f"load in the last round: {loaded}",
            f"counted since the set-up: {counted}",
            f"not obtained: {', '.join(missing) or 'nothing'}",
        ]

    def print(self) -> None:
        """Print the table."""
        print(
            f"\n{self.rate_hz:g} Hz{'':<14}  lateness in µs: p50    p99  p99.9      max   skipped"
        )
        for name, runs in self.runs.items():
            if runs:
                skipped, cycles = sum(run.skipped for run in runs), sum(map(_cycles, runs))
                share = f"{skipped} of {cycles} ({100 * skipped / cycles:.3f} %)"
                print(_row(f"{name}, wake-up", _wake(runs)), share)
                for what in ("write", "busy"):
                    late_ns = np.concatenate([getattr(run, f"{what}_ns") for run in runs])
                    if late_ns.size:
                        print(_row(f"{name}, {what}", late_ns))
        if self.runs[QUIET]:
            self._print_skipped()
            self._print_ratios()
        if not self.runs["cyclictest"]:
            print("  no cyclictest: install the package rt-tests")
        for note in (*self.notes, *self.left_run):
            print(f"  {note}")

    def _print_skipped(self) -> None:
        """Print the skipped share of each run beside that of the floor in the same round."""
        pairs = zip(self.runs[QUIET], self.runs[FLOOR], strict=False)
        each = [(100 * _skipped_share(ours), 100 * _skipped_share(floor)) for ours, floor in pairs]
        beyond = [ours - 2 * floor for ours, floor in each]
        told = ", ".join(f"{ours:.3f}/{floor:.3f}" for ours, floor in each)
        print(f"  skipped in % of piezod/floor, pair by pair: {told}")
        print(f"  median of piezod's minus twice the floor's: {np.median(beyond):+.3f} %")

    def _print_ratios(self) -> None:
        base = _p999(_wake(self.runs[FLOOR]))
        for name in filter(self.runs.get, (QUIET, LOADED)):
            ratio = _p999(_wake(self.runs[name])) / base
            print(f"  p99.9 at wake-up, {name} to floor: {ratio:.2f}")
        for what in ("wake_ns", "write_ns"):
            each = [
                (_p999(getattr(quiet, what)), _p999(getattr(loaded, what)))
                for quiet, loaded in self.pairs
                if getattr(quiet, what).size and getattr(loaded, what).size
            ]
            if not each:
                continue
            change_us = [(loaded - quiet) / 1000 for quiet, loaded in each]
            percent = [100 * (loaded - quiet) / max(quiet, 1) for quiet, loaded in each]
            low, high = min(change_us), max(change_us)
            print(
                f"  change of p99.9 by load, {what[:-3]}: median of {len(each)} pairs "
                f"{np.median(change_us):+.1f} µs ({np.median(percent):+.0f} %), "
                f"from {low:+.1f} to {high:+.1f} µs"
            )


def _cycles(run: Lateness) -> int:
    return run.wake_ns.size + run.skipped


def _skipped_share(run: Lateness) -> float:
    return run.skipped / _cycles(run)


def _wake(runs: list[Lateness]) -> Nanoseconds:
    return np.concatenate([run.wake_ns for run in runs])


def _p999(late_ns: Nanoseconds) -> float:
    return float(np.percentile(late_ns, 99.9))


def _row(name: str, late_ns: Nanoseconds) -> str:
    p50, p99, p999, worst = np.percentile(late_ns, [50, 99, 99.9, 100]) / 1000
    return f"  {name:<32}{p50:8.1f}{p99:7.1f}{p999:7.1f}{worst:9.1f}  "


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--long", action="store_true", help="7 rounds at all rates, not 1 at 1 kHz")
    parser.add_argument("--rates", help="rates in Hz, separated by commas")
    parser.add_argument("--rounds", type=int, help="how many rounds")
    parser.add_argument("--seconds", type=int, help="seconds of each run, at most 15")
    parser.add_argument("--spin-us", type=float, help="spin before the deadline, 40 µs at most")
    parser.add_argument("--compiled", action="store_true", help="measure the compiled build")
    parser.add_argument("--quiet", action="store_true", help="leave out the runs under load")
    asked = parser.parse_args()
    rates = asked.rates or ("1000,2000,5000,10000" if asked.long else "1000")
    rounds = asked.rounds or (7 if asked.long else 1)
    seconds = asked.seconds or (10 if asked.long else 5)
    cpu = max(os.sched_getaffinity(0))
    build = COMPILED if asked.compiled else None
    found = [Rounds(float(rate), build, loads=not asked.quiet) for rate in rates.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        program = compile_floor(Path(folder))
        for number in range(rounds):
            for each in found:
                print(f"round {number + 1} of {rounds}, {each.rate_hz:g} Hz", flush=True)
                spin_us = asked.spin_us or min(40.0, 0.3e6 / each.rate_hz)
                each.run(program, Pacing(each.rate_hz, seconds, 60, cpu, round(spin_us * 1000)))
    for each in found:
        each.print()


if __name__ == "__main__":
    main()
