"""What is written out beside the service."""

import asyncio
import io
from math import nan
from pathlib import Path

import pytest

from piezod.config.states import State
from piezod.daemon import accepted_config
from piezod.daemon.housekeeping import Housekeeping
from piezod.daemon.logging import set_up_logging
from piezod.telemetry.events import EventWriter, LoopEvent
from tests.daemon.bench import PEER, Bench


@pytest.fixture
def log() -> io.StringIO:
    """Return what is logged, for people."""
    stream = io.StringIO()
    set_up_logging(stream, {})
    return stream


@pytest.fixture
def bench(tmp_path: Path, rig_file: Path) -> Bench:
    """Return a stage."""
    return Bench(tmp_path, accepted_config.load(rig_file))


def test_events_of_the_loop_are_logged(bench: Bench, log: io.StringIO) -> None:
    """Text first, then what it is about; a number that does not apply is left out."""
    event = LoopEvent(5, "error", "fault", "no sample for 4 cycles", "S5", "x", 4.0, nan)
    EventWriter(bench.loop.shared).append(event)
    house = Housekeeping(bench.link)

    house.log_events()
    asyncio.run(house.close())

    assert "error" in log.getvalue()
    assert "fault: no sample for 4 cycles" in log.getvalue()
    assert "axis=x fault=S5" in log.getvalue()


def test_end_writes_what_a_fault_wants_to_be_kept(bench: Bench, log: io.StringIO) -> None:
    """A loop that dies of a fault has its last seconds on the disk, and a recording is closed."""
    bench.record(State.RUN, drive_v=3.0)
    bench.do(lambda link: link.start_recording("last", PEER))
    event = LoopEvent(5, "error", "fault", "it is gone", "A1", "x", nan, nan)
    EventWriter(bench.loop.shared).append(event)

    asyncio.run(Housekeeping(bench.link).close())

    assert len(list(bench.paths.flights.glob("*-A1.h5"))) == 1
    assert "flight recorded" in log.getvalue()
    assert not bench.link.recordings_of_stage.under_way


def test_recording_on_request(bench: Bench) -> None:
    """It is listed while it goes on and after it was stopped, once in each list."""
    started = bench.do(lambda link: link.start_recording(None, PEER))
    under_way, finished = bench.do(lambda link: link.recordings())
    stopped = bench.do(lambda link: link.stop_recording(PEER))
    none, files = bench.do(lambda link: link.recordings())
    asyncio.run(Housekeeping(bench.link).close())

    assert under_way is not None
    assert (under_way["name"], finished) == (started["name"], [])
    assert (stopped["name"], stopped["records"]) == (started["name"], 0)
    assert none is None
    assert [file["name"] for file in files] == [started["name"]]
