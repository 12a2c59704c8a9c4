"""What a long recording costs: `python benchmarks/bench_recordings.py [--minutes 60]`.

Writes a recording of one axis at 1 kHz, with noise of a sensor in the samples, and prints its size;
then time and peak memory of each command that reads it, each in a process of its own; then the time
of a view of a column, as a ratio to that of reading the raw column.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.writer import TelemetryWriter
from piezod.records.view import RecordingView
from piezod.telemetry.arrays import record_dtype
from piezod.telemetry.descriptions import descriptions, mask_bits
from piezod.telemetry.layout import enumerations

RATE_HZ: Final = 1000.0
PORTION: Final = 10_000
COLUMN: Final = "axis_x/position_um"
LAUNCH: Final = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
"""Runs a command from a small process: the memory of a child begins with that of its parent."""
PIEZOD: Final = (sys.executable, "-m", "piezod")
COMMANDS: Final = {
    "python -c pass": (sys.executable, "-c", "pass"),
    "record show": (*PIEZOD, "record", "show", "rec.h5"),
    "record plot": (*PIEZOD, "record", "plot", "rec.h5"),
    "record export, CSV": (*PIEZOD, "record", "export", "rec.h5"),
    "record export, Parquet": (*PIEZOD, "record", "export", "rec.h5", "--out", "rec.parquet"),
}


def cycles(begin: int, random: np.random.Generator) -> NDArray[Any]:
    """Return a portion of records of a stage that scans with 1 Hz."""
    made = np.zeros(PORTION, record_dtype(1))
    number = np.arange(begin, begin + PORTION)
    made["seq"], made["t_ns"] = number + 1, number * round(1e9 / RATE_HZ)
    for name in ("late_ns", "read_ns", "compute_ns", "write_late_ns", "write_ns"):
        made[name] = random.normal(40_000, 5000, PORTION)
    made["state"], made["written"] = list(State).index(State.RUN), True
    axis = made["axes"][:, 0]
    axis["mode"] = list(Mode).index(Mode.TRIMMED)
    axis["sample_ns"] = made["t_ns"] + random.normal(10_000, 2000, PORTION)
    axis["command_um"] = 5.0 * (1.0 - np.cos(2.0 * np.pi * number / RATE_HZ))
    axis["target_um"] = axis["read_back_v"] = np.nan
    axis["position_um"] = axis["command_um"] + random.normal(0.0, 0.005, PORTION)
    axis["uncompensated_v"] = 10.0 * axis["command_um"]
    axis["trim_um"] = 0.1 * np.sin(number / 1e4)
    for name in ("asked_v", "drive_v", "in_force_v"):
        axis[name] = axis["uncompensated_v"] + 3.0 * np.sin(2.0 * np.pi * number / RATE_HZ)
    return made


def write(path: Path, minutes: float) -> None:
    """Write the recording."""
    header = TelemetryHeader(
        title="benchmark",
        axes=("x",),
        rate_hz=RATE_HZ,
        started_at="2024-05-01T12:00:00+00:00",
        start_ns=0,
        names={name: [str(m.value) for m in members] for name, members in enumerations().items()},
        descriptions=descriptions(),
        bits=mask_bits(),
    )
    random = np.random.default_rng(1)
    with TelemetryWriter(path, header, record_dtype(1)) as writer:
        for begin in range(0, round(60 * minutes * RATE_HZ), PORTION):
            writer.append(cycles(begin, random))


def run(command: tuple[str, ...], folder: Path) -> tuple[float, float]:
    """Run a command; return its time in s and its peak memory in MB."""
    begin_s = time.perf_counter()
    launched = (sys.executable, "-c", LAUNCH, *command)
    done = subprocess.run(launched, cwd=folder, check=True, capture_output=True)  # noqa: S603 - ours
    return time.perf_counter() - begin_s, int(done.stdout) / 1024


def time_of(action: Callable[[], object], rounds: int = 5) -> float:
    """Return the median time of an action, in s."""
    times_s = []
    for _ in range(rounds):
        begin_s = time.perf_counter()
        action()
        times_s.append(time.perf_counter() - begin_s)
    return median(times_s)


def measure_views(path: Path, minutes: float) -> None:
    """Print the times of views as ratios to reading the raw column."""
    with h5py.File(path, "r", swmr=True) as file:
        raw_s = time_of(lambda: file["recording"][COLUMN][:])
    first_s = time_of(lambda: RecordingView(path).view(COLUMN), rounds=3)
    opened = RecordingView(path)
    opened.view(COLUMN)
    whole_s = 60 * minutes
    print(f"view of 2000 points; raw column {1e3 * raw_s:.1f} ms, ratios to it")
    print(f"  {'first view, all of it':26} {1e3 * first_s:8.1f} ms {first_s / raw_s:7.3f}")
    spans = {"all of it": 1.0, "a third": 1 / 3, "a tenth": 0.1, "a thousandth": 0.001}
    for name, share in spans.items():
        begin_s = 0.31 * whole_s if share < 1 else 0.0
        end_s = begin_s + share * whole_s
        view_s = time_of(lambda begin_s=begin_s, end_s=end_s: opened.view(COLUMN, begin_s, end_s))  # type: ignore[misc]
        print(f"  {'later view, ' + name:26} {1e3 * view_s:8.1f} ms {view_s / raw_s:7.3f}")
    opened.close()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    minutes = parser.parse_args().minutes
    with tempfile.TemporaryDirectory(prefix="pz-") as name:
        folder = Path(name)
        path = folder / "rec.h5"
        begin_s = time.perf_counter()
        write(path, minutes)
        written_s = time.perf_counter() - begin_s
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        size_mb = path.stat().st_size / 1e6
        print(f"{minutes:g} min at {RATE_HZ:g} Hz, one axis: {size_mb:.1f} MB")
        print(f"  {'writing':26} {written_s:8.1f} s  {peak_mb:7.0f} MB at most")
        measure_views(path, minutes)
        print("commands")
        for command, words in COMMANDS.items():
            taken_s, mb = run(words, folder)
            print(f"  {command:26} {taken_s:8.1f} s  {mb:7.0f} MB at most", flush=True)
        for file in sorted(folder.iterdir()):
            print(f"  {file.name:26} {file.stat().st_size / 1e6:8.1f} MB")


if __name__ == "__main__":
    main()
