"""What is written out beside the service."""

import asyncio
import io
import time
from datetime import datetime, timedelta
from math import nan
from pathlib import Path

import pytest

from piezod.config.states import State
from piezod.daemon.logging import set_up_logging
from piezod.daemon.loop import accept
from piezod.daemon.supervisor.housekeeping import Housekeeping
from piezod.telemetry.events import EventWriter
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S
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
    return Bench(tmp_path, accept.load(rig_file))


def test_events_of_the_loop_are_logged(bench: Bench, log: io.StringIO) -> None:
    """Its own time and its text first, then what it is about; NaN says nothing."""
    hour_ago_ns = time.monotonic_ns() - 3600 * NS_PER_S
    event = StageEvent(hour_ago_ns, "error", "fault", "no sample", "S5", "x", 4.0, nan)
    before = datetime.now().astimezone() - timedelta(hours=1, minutes=1)
    EventWriter(bench.loop.shared).append(event)
    house = Housekeeping(bench.link)

    house.log_events()
    asyncio.run(house.close())

    time_of_day, _, line = log.getvalue().partition(" ")
    assert "error" in line
    assert "fault: no sample" in line
    assert "axis=x fault=S5 measured=4.0" in line
    assert "limit" not in line
    assert time_of_day[:2] in {(before + timedelta(minutes=i)).strftime("%H") for i in (0, 2)}


def test_end_writes_what_a_fault_wants_to_be_kept(bench: Bench, log: io.StringIO) -> None:
    """A loop that dies of a fault has its last seconds on the disk, and a recording is closed."""
    bench.record(State.RUN, drive_v=3.0)
    bench.do(lambda link: link.start_recording("last", PEER))
    event = StageEvent(5, "error", "fault", "it is gone", "A1", "x", nan, nan)
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
