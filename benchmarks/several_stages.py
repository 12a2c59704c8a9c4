"""Whether stages disturb each other: `python benchmarks/several_stages.py`.

Spans with one simulated stage alternate with spans with four of them, each at 1 kHz, following a
sine adaptively, recorded, and watched in a tab of `piezod web`. With `--ioc` a third span has one
IOC for the four, with a client that monitors each; it needs `make build/epics/.installed`. Prints
the late and the skipped cycles of each stage in each span, and the sums at the end. Then the loop
of one of the four is killed in the middle of a span, and the supervisor in the middle of another.
The exit code is 1 if another stage has left RUN, or a cycle is missing in its file.
"""

import argparse
import asyncio
import os
import signal
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import h5py

from benchmarks.bench_page import RATE_HZ, STAGE, opened_tabs, start_stage, started
from benchmarks.page_and_recording import SINE, counts, drain, missing_cycles
from piezod.client import StageClient, running_stages
from piezod.client.calls import Call
from piezod.config.states import State
from piezod.daemon.paths import stage_paths
from piezod.errors import RefusedError
from piezod.messages.endpoints import ENDPOINTS
from piezod.messages.stores import Recording
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from tests.daemon.daemons import is_alive
from tests.epics.processes import Ioc, peer

OTHERS: Final = ("second", "third", "fourth")
ALL: Final = (STAGE, *OTHERS)
VICTIM: Final = OTHERS[-1]
"""The stage whose processes are killed."""
SHOWN: Final = ("STATE", "LOOP:LATE", "x.RBV", "x:DRIVE", "x:HIST:POS")
"""Records that the client of the IOC monitors."""
RUN: Final = list(State).index(State.RUN)
"""How a recording has this state."""
LONG_S: Final = 3600.0
UP_WITHIN_S: Final = 600.0
"""Longest time for all stages to start, in s: they start beside loops that move."""
START_RECORDING: Final[Call[Recording]] = Call(ENDPOINTS["start_recording"], {})
STOP_RECORDING: Final[Call[Recording]] = Call(ENDPOINTS["stop_recording"], {})


class Span(NamedTuple):
    """What was measured of one stage in one span."""

    late: int
    skipped: int
    missing: int
    stayed: bool
    """Whether it was in RUN in every cycle of its file, and is."""


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


async def watched(url: str, stages: Sequence[str], duration_s: float, victim_pid: int = 0) -> None:
    """Hold a tab open for each stage; kill a process in the middle if one is given."""
    async with AsyncExitStack() as stack:
        for socket in await opened_tabs(url, stack, stages):
            stack.callback(asyncio.create_task(drain(socket)).cancel)
        await asyncio.sleep(duration_s / 2)
        if victim_pid:
            os.kill(victim_pid, signal.SIGKILL)
        await asyncio.sleep(duration_s / 2)


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


def always_runs(file: Path) -> bool:
    """Return whether a stage was in RUN in every cycle of a recording."""
    with h5py.File(file, "r") as opened:
        return bool((opened["recording/cycles/state"][:] == RUN).all())


def span_of(
    stages: Sequence[str], url: str, span_s: float, folder: Path, victim_pid: int = 0
) -> Mapping[str, Span]:
    """Let stages move for a span; return what was measured of each, and print it.

    Args:
        stages: Names of the stages.
        url: Address of the page.
        span_s: Length of the span, in s.
        folder: Folder for the recordings.
        victim_pid: A process of `VICTIM` to kill in the middle; that stage is not measured then.
    """
    with ExitStack() as stack:
        clients = {name: stack.enter_context(StageClient(name)) for name in stages}
        for client in clients.values():
            start_moving(client)
            # The first recording imports HDF5, which takes long beside many loops.
            client.call(replace(START_RECORDING, answer_within_s=UP_WITHIN_S))
        if victim_pid:
            del clients[VICTIM]
        before = {name: counts(client) for name, client in clients.items()}
        asyncio.run(watched(url, stages, span_s, victim_pid))
        after = {name: counts(client) for name, client in clients.items()}
        found = {}
        for name, client in clients.items():
            status = client.status()
            recording = client.call(replace(STOP_RECORDING, answer_within_s=UP_WITHIN_S))
            file = folder / f"{name}-{recording.name}.h5"
            client.fetch_recording(recording.name, file)
            skipped, late = (b - a for a, b in zip(before[name], after[name], strict=True))
            stayed = status.state == "RUN" and always_runs(file)
            found[name] = span = Span(late, skipped, missing_cycles(file), stayed)
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


def kill(url: str, span_s: float, *, with_ioc: bool) -> bool:
    """Kill the loop, then the supervisor of one of four stages; return whether the others went on.

    They have gone on if they were in RUN all the time, and their files have every cycle.
    """
    folder = Path(os.environ["XDG_RUNTIME_DIR"])
    found: list[Span] = []
    with ExitStack() as others:
        recordings = Path(others.enter_context(tempfile.TemporaryDirectory()))
        for name in OTHERS:
            if name != VICTIM:
                start_stage(others, folder, name)
        for part in ("loop", "supervisor"):
            supervisor = start_stage(others, folder, VICTIM)
            wait_for(OTHERS)
            make_safe(VICTIM)
            loop_map = stage_paths(folder / f"{VICTIM}.yaml", os.environ).loop_map
            loop = attach(loop_map).words[Word.LOOP_PID]
            with served(folder, ALL) if with_ioc else nullcontext():
                print(f"{part} of {VICTIM} killed in the middle:")
                victim_pid = loop if part == "loop" else supervisor
                found += span_of(ALL, url, span_s, recordings, victim_pid).values()
            wait_for_end(supervisor, loop)
    late, skipped = sum(each.late for each in found), sum(each.skipped for each in found)
    missing, left = sum(each.missing for each in found), sum(not each.stayed for each in found)
    periods = span_s * RATE_HZ * len(found)
    print(
        f"sum  others of a kill late {late} ({late / periods:.2%}), skipped {skipped} "
        f"({skipped / periods:.2%}), missing {missing}; left RUN: {left} of {len(found)}"
    )
    return not missing and not left


def make_safe(name: str) -> None:
    """Clear the faults of a stage that has been killed before."""
    end_s = time.monotonic() + UP_WITHIN_S
    with StageClient(name) as stage:
        while stage.status().state != "SAFE":
            if time.monotonic() > end_s:
                raise TimeoutError(f"stage {name} has faults")
            with suppress(RefusedError):
                stage.reset()
            time.sleep(0.2)


def wait_for_end(*pids: int) -> None:
    """Wait until processes have ended: each of the two ends without the other."""
    end_s = time.monotonic() + UP_WITHIN_S
    while any(map(is_alive, pids)):
        if time.monotonic() > end_s:
            raise TimeoutError("the rest of the killed stage does not end")
        time.sleep(0.2)


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
        went_on = kill(url, options.span_s, with_ioc=options.ioc)
    sys.exit(0 if went_on else 1)


if __name__ == "__main__":
    main()
