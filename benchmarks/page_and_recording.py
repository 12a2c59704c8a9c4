"""Whether a page and a recording disturb the loop: `python benchmarks/page_and_recording.py`.

A simulated stage follows a sine at 1 kHz. Spans with three tabs at 30 Hz and a recording alternate
with spans without. Prints for each span the skipped and the late cycles, what supervisor and server
take, and their memory; at the end the sums, how many more cycles are late with a page, and a
verdict: it fails, with exit code 1, if a cycle is missing in a file, or if supervisor and server
take too much of a core.
"""

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack, ExitStack
from math import nan, sqrt
from pathlib import Path
from statistics import fmean, stdev
from typing import Final, NamedTuple

import h5py
from websockets.asyncio.client import ClientConnection

from benchmarks.bench_page import RATE_HZ, STAGE, cpu_s, opened_tabs, resident_mb, started
from piezod.client import StageClient
from piezod.config.waveforms.shapes import Sine

LARGEST_PART: Final = 0.15
"""Supervisor and server together take less than this part of a core."""
WITHOUT: Final = "none"
WITH: Final = "page, recording"
"""Titles of the spans."""
SINE: Final = Sine(kind="sine", low=2.0, high=20.0, frequency_hz=1.0)


class Span(NamedTuple):
    """What was measured in one span."""

    skipped: int
    late: int
    part: float
    megabytes: tuple[float, ...]


def counts(stage: StageClient) -> tuple[int, int]:
    """Return the skipped cycles, and the cycles that began late."""
    late = 0.0
    for line in stage.metrics().splitlines():
        if line.startswith("piezod_late_cycles_total"):
            late = float(line.split()[1])
    return stage.status().skipped_cycles, round(late)


async def drain(socket: ClientConnection) -> None:
    """Read all that a tab gets."""
    async for _ in socket:
        pass


async def with_page(url: str, duration_s: float) -> None:
    """Hold tabs open that watch the stage."""
    async with AsyncExitStack() as stack:
        for socket in await opened_tabs(url, stack):
            stack.callback(asyncio.create_task(drain(socket)).cancel)
        await asyncio.sleep(duration_s)


def missing_cycles(file: Path) -> int:
    """Return how many cycles a recording lacks: periods between its ends that it cannot explain."""
    with h5py.File(file, "r") as opened:
        entry = opened["recording"]
        t_s, skipped = entry["cycles/t_s"][:], entry["cycles/skipped"][:]
        lost = int(entry.attrs["lost"])
    periods: int = round((t_s[-1] - t_s[0]) * RATE_HZ) + 1
    by_loop = int(skipped[-1] - skipped[0])
    print(f"  {file.name}: {t_s.size} cycles in {periods} periods, {by_loop} skipped by the loop")
    return max(lost, int(periods) - by_loop - int(t_s.size))


def span_of(
    stage: StageClient, pids: dict[str, int], span_s: float, url: str, folder: Path | None
) -> tuple[Span, int]:
    """Measure one span; with a folder for the recording, tabs and a recording are there.

    Returns:
        What was measured, and how many cycles are missing in the recording.
    """
    before, taken = counts(stage), sum(cpu_s(pid) for pid in pids.values())
    begun_s = time.monotonic()
    if folder:
        stage.start_recording()
        asyncio.run(with_page(url, span_s))
    else:
        time.sleep(span_s)
    part = (sum(cpu_s(pid) for pid in pids.values()) - taken) / (time.monotonic() - begun_s)
    after = counts(stage)
    megabytes = tuple(resident_mb(pid) for pid in pids.values())
    missing = 0
    if folder:
        recording = stage.stop_recording()
        file = folder / f"{recording.name}.h5"
        stage.fetch_recording(recording.name, file)
        missing = missing_cycles(file)
    return Span(after[0] - before[0], after[1] - before[1], part, megabytes), missing


def measure(pids: dict[str, int], url: str, span_s: float, spans: int) -> list[str]:
    """Alternate spans with and without page and recording; print all, and return what fails."""
    found: dict[str, list[Span]] = {WITHOUT: [], WITH: []}
    missing = 0
    with StageClient(STAGE) as stage, tempfile.TemporaryDirectory() as folder:
        while stage.status().state == "BOOT":
            time.sleep(0.2)
        stage.arm()
        stage.mode("adaptive")
        stage.wave({"x": SINE}, 4 * span_s * spans + 600.0)
        for _ in range(spans):
            for title, spans_so_far in found.items():
                where = Path(folder) if title == WITH else None
                span, lacking = span_of(stage, pids, span_s, url, where)
                spans_so_far.append(span)
                missing += lacking
                memory = ", ".join(f"{each:.0f} MB" for each in span.megabytes)
                print(
                    f"{title:16} skipped {span.skipped}, late {span.late}, supervisor and server "
                    f"{span.part:.1%} of a core, {memory}",
                    flush=True,
                )
        state = stage.status().state
        stage.stop()
    for title, each in found.items():
        print(
            f"{title:16} sum: skipped {sum(s.skipped for s in each)}, late "
            f"{sum(s.late for s in each)}, at most {max(s.part for s in each):.1%} of a core"
        )
    more, error = difference([s.late for s in found[WITHOUT]], [s.late for s in found[WITH]])
    print(f"late cycles in a span: {more:+.1f} ± {error:.1f} with page and recording")
    print(f"missing in the recordings: {missing} cycles; the stage is in {state}")
    return failures(missing, max(each.part for each in found[WITH]))


def difference(without: Sequence[int], with_page: Sequence[int]) -> tuple[float, float]:
    """Return how many more of a count spans with a page have, and the standard error of that.

    Args:
        without: The count in each span without a page.
        with_page: That in the span after it.
    """
    more = [b - a for a, b in zip(without, with_page, strict=True)]
    return fmean(more), stdev(more) / sqrt(len(more)) if len(more) > 1 else nan


def failures(missing: int, part: float) -> list[str]:
    """Return what is worse than promised, a sentence each.

    Args:
        missing: Cycles that the files lack.
        part: Largest part of a core that supervisor and server took with a page.
    """
    found = [f"cycles missing in the recordings: {missing}"] if missing else []
    if part >= LARGEST_PART:
        found.append(f"supervisor and server take {part:.1%} of a core, not < {LARGEST_PART:.0%}")
    return found


def main() -> None:
    """Start stage and server, and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--span-s", type=float, default=100.0)
    parser.add_argument("--spans", type=int, default=6)
    options = parser.parse_args()
    with ExitStack() as stack:
        pids, url = started(stack)
        failed = measure(pids, url, options.span_s, options.spans)
    print("failed: " + "; ".join(failed) if failed else "passed")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
