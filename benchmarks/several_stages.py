"""Whether stages disturb each other: `python benchmarks/several_stages.py`.

Spans with one simulated stage alternate with spans with four of them, each at 1 kHz, following a
sine adaptively, recorded, and watched in a tab of `piezod web`. With `--ioc` a third span has one
IOC for the four, with a client that monitors each; it needs `make build/epics/.installed`. Prints
the late and the skipped cycles of each stage in each span, and the sums at the end.
"""

import argparse
import asyncio
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from benchmarks.bench_page import RATE_HZ, STAGE, opened_tabs, start_stage, started
from benchmarks.page_and_recording import SINE, counts, drain, missing_cycles
from piezod.client import StageClient, running_stages
from piezod.client.calls import Call
from piezod.client.reader import reader
from piezod.client.results import Recording
from piezod.config.endpoints import ENDPOINTS
from piezod.errors import RefusedError
from tests.epics.processes import Ioc, peer

OTHERS: Final = ("second", "third", "fourth")
ALL: Final = (STAGE, *OTHERS)
SHOWN: Final = ("STATE", "LOOP:LATE", "x.RBV", "x:DRIVE", "x:HIST:POS")
"""Records that the client of the IOC monitors."""
LONG_S: Final = 3600.0
UP_WITHIN_S: Final = 600.0
"""Longest time for all stages to start, in s: they start beside loops that move."""
START_RECORDING: Final = Call(ENDPOINTS["start_recording"], reader(Recording), {})
STOP_RECORDING: Final = Call(ENDPOINTS["stop_recording"], reader(Recording), {})


class Span(NamedTuple):
    """What was measured of one stage in one span."""

    late: int
    skipped: int
    missing: int


def wait_for(stages: Sequence[str]) -> None:
    """Wait until stages have left BOOT."""
    end_s = time.monotonic() + UP_WITHIN_S
    for name in stages:
        while not _is_up(name):
            if time.monotonic() > end_s:
                raise TimeoutError(f"stage {name} did not come up")
            time.sleep(0.2)


def _is_up(name: str) -> bool:
    if name not in running_stages():
        return False
    with StageClient(name) as stage:
        return stage.status().state != "BOOT"


def start_moving(client: StageClient) -> None:
    """Let a stage follow the sine adaptively; a busy machine may need several attempts."""
    end_s = time.monotonic() + UP_WITHIN_S
    while client.status().state != "RUN" or not client.status().axes["x"].motion:
        try:
            client.arm()
            client.mode("adaptive")
            client.wave({"x": SINE}, LONG_S)
        except RefusedError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.5)


async def watched(url: str, stages: Sequence[str], duration_s: float) -> None:
    """Hold a tab open for each stage."""
    async with AsyncExitStack() as stack:
        for socket in await opened_tabs(url, stack, stages):
            stack.callback(asyncio.create_task(drain(socket)).cancel)
        await asyncio.sleep(duration_s)


@contextmanager
def served(folder: Path, stages: Sequence[str]) -> Iterator[None]:
    """Serve all stages as EPICS records while the block runs, and monitor some."""
    ioc = Ioc(folder, "--control").up(len(stages))
    try:
        with peer("aioca", ioc.environ) as client:
            for name in (f"{stage}:{each}" for stage in stages for each in SHOWN):
                client.watch(name)
            yield
    finally:
        ioc.end()


def span_of(stages: Sequence[str], url: str, span_s: float, folder: Path) -> Mapping[str, Span]:
    """Let stages move for a span; return what was measured of each, and print it."""
    with ExitStack() as stack:
        clients = {name: stack.enter_context(StageClient(name)) for name in stages}
        for client in clients.values():
            start_moving(client)
            # The first recording imports HDF5, which takes long beside many loops.
            client.call(replace(START_RECORDING, answer_within_s=UP_WITHIN_S))
        before = {name: counts(client) for name, client in clients.items()}
        asyncio.run(watched(url, stages, span_s))
        after = {name: counts(client) for name, client in clients.items()}
        found = {}
        for name, client in clients.items():
            status = client.status()
            recording = client.call(replace(STOP_RECORDING, answer_within_s=UP_WITHIN_S))
            file = folder / f"{name}-{recording.name}.h5"
            client.fetch_recording(recording.name, file)
            skipped, late = (b - a for a, b in zip(before[name], after[name], strict=True))
            found[name] = span = Span(late, skipped, missing_cycles(file))
            processor = status.processor.number if status.processor else "?"
            print(
                f"{len(stages)} stages  {name:7} processor {processor}  late {late}, skipped "
                f"{skipped} of {span_s * RATE_HZ:.0f}, missing {span.missing}; {status.state}",
                flush=True,
            )
            client.release_lease()
    return found


def measure(url: str, span_s: float, rounds: int, *, with_ioc: bool) -> None:
    """Alternate spans with one stage, with four, and with four and an IOC; print all, and sums."""
    found: dict[str, list[Span]] = defaultdict(list)
    folder = Path(os.environ["XDG_RUNTIME_DIR"])
    wait_for([STAGE])
    with tempfile.TemporaryDirectory() as directory:
        recordings = Path(directory)
        for _ in range(rounds):
            found["alone"].append(span_of([STAGE], url, span_s, recordings)[STAGE])
            with ExitStack() as others:
                for name in OTHERS:
                    start_stage(others, folder, name)
                wait_for(OTHERS)
                for name, span in span_of(ALL, url, span_s, recordings).items():
                    found[name].append(span)
                if with_ioc:
                    print("with an IOC for all:")
                    others.enter_context(served(folder, ALL))
                    for name, span in span_of(ALL, url, span_s, recordings).items():
                        found[f"{name} + IOC"].append(span)
    for title, spans in found.items():
        periods = span_s * RATE_HZ * len(spans)
        late, skipped = sum(each.late for each in spans), sum(each.skipped for each in spans)
        print(
            f"sum  {title:12} late {late} ({late / periods:.2%}), skipped {skipped} "
            f"({skipped / periods:.2%}), missing {sum(each.missing for each in spans)}"
        )


def main() -> None:
    """Start a stage and the server of the page, and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--span-s", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--ioc", action="store_true")
    options = parser.parse_args()
    with ExitStack() as stack:
        _, url = started(stack)
        measure(url, options.span_s, options.rounds, with_ioc=options.ioc)


if __name__ == "__main__":
    main()
