"""Log of the loop's events, recordings and flight records."""

import asyncio
import io
import shutil
import time
from dataclasses import replace
from datetime import datetime, timedelta
from math import nan

import h5py
import pytest

from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.daemon.lean_structlog import structlog
from piezod.daemon.logging import MAX_LINES, WINDOW_S, EventRateLimit
from piezod.daemon.stage import recordings
from piezod.daemon.stage.errors import NotNowError
from piezod.daemon.stores import recorder
from piezod.daemon.supervisor.housekeeping import Housekeeping
from piezod.messages.stores import Recording
from piezod.telemetry.events import EventWriter
from piezod.telemetry.record import StageEvent
from piezod.telemetry.words import SUPERVISOR_FAULTS, Word
from piezod.units import NS_PER_S
from tests.daemon.bench import PEER, Bench
from tests.daemon.waiting import eventually
from tests.records.killed import killed


def test_housekeeping_without_a_fault_makes_no_header(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A header costs a millisecond; it is made only if a flight record is due."""
    made: list[object] = []
    monkeypatch.setattr(recordings, "TelemetryHeader", lambda **fields: made.append(fields))

    asyncio.run(bench.link.stage_recordings.write_flight(bench.loop))

    assert made == []


def test_events_of_the_loop_are_logged(bench: Bench, log: io.StringIO) -> None:
    """A line has the instant of the event, its text, then its fields; NaN is left out."""
    hour_ago_ns = time.monotonic_ns() - 3600 * NS_PER_S
    event = StageEvent(hour_ago_ns, "error", "fault", "no sample", "S5", "x", 4.0, nan)
    before = datetime.now().astimezone() - timedelta(hours=1, minutes=1)
    EventWriter(bench.loop.shared).append(event)
    housekeeping = Housekeeping(bench.link)

    housekeeping.log_events()
    asyncio.run(housekeeping.close())

    time_of_day, _, line = log.getvalue().partition(" ")
    assert "error" in line
    assert "fault: no sample" in line
    assert "axis=x fault=S5 measured=4.0" in line
    assert "limit" not in line
    assert time_of_day[:2] in {(before + timedelta(minutes=i)).strftime("%H") for i in (0, 2)}


def test_end_writes_the_flight_record_of_a_fault(bench: Bench, log: io.StringIO) -> None:
    """The last seconds of a loop that ends with a fault are written, and a recording is closed."""
    bench.record(State.RUN, drive_v=3.0)
    bench.do(lambda link: link.start_recording("last", PEER))
    event = StageEvent(5, "error", "fault", "it is gone", "A1", "x", nan, nan)
    EventWriter(bench.loop.shared).append(event)

    asyncio.run(Housekeeping(bench.link).close())

    assert len(list(bench.paths.flights.glob("*-A1.h5"))) == 1
    assert "flight recorded" in log.getvalue()
    assert not bench.link.stage_recordings.running_name


@pytest.mark.fault("P8")
def test_recordings_of_a_killed_daemon_are_repaired(bench: Bench, log: io.StringIO) -> None:
    """At the next start recordings and flight records open plainly; a damaged one is named."""
    killed(bench.paths.recordings / "20260101T120000Z.h5", 50)
    killed(bench.paths.flights / "20260101T120000Z-A1.h5", 50)
    damaged = bench.paths.recordings / "20260102T120000Z.h5"
    damaged.write_bytes(b"text")

    asyncio.run(bench.link.stage_recordings.repair())

    for folder, name in ((bench.paths.recordings, ""), (bench.paths.flights, "-A1")):
        with h5py.File(folder / f"20260101T120000Z{name}.h5") as root:
            assert root["recording/cycles/seq"].size == 50
    assert f"{damaged}: it is not a recording" in log.getvalue()
    assert log.getvalue().count("recording was not closed: repaired") == 2
    asyncio.run(Housekeeping(bench.link).close())


@pytest.mark.fault("P6")
def test_recording_that_the_disk_ends_is_a_fault(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """P6 is reported until a client asks for the end of the recording, which has the reason."""
    monkeypatch.setattr(recorder, "DRAIN_S", 0.0)
    name = bench.do(lambda link: link.start_recording(None, PEER)).name
    usage = shutil.disk_usage(bench.paths.recordings)._replace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    eventually(lambda: not bench.link.stage_recordings.running_name)

    before = bench.reported()
    stopped = bench.do(lambda link: link.stop_recording(PEER))

    assert before == [Fault.P6]
    assert (stopped.name, stopped.disk_full) == (name, True)
    assert "0 MB are free" in stopped.why
    assert bench.reported() == []
    with pytest.raises(NotNowError, match="nothing is being recorded"):
        bench.do(lambda link: link.stop_recording(PEER))
    asyncio.run(Housekeeping(bench.link).close())


@pytest.mark.fault("P7")
def test_recording_that_loses_cycles_is_a_fault(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """P7 is reported as long as further cycles are lost, also by the next recording."""
    found = []
    status = Recording(True, "one", 100, 0, "")
    for name, lost in [("one", 0), ("one", 7), ("one", 7), ("one", 9), ("two", 3), ("two", 3)]:
        now = replace(status, name=name, lost=lost)
        monkeypatch.setattr(recorder.Recorder, "status", now)
        found.append(bench.reported())

    assert found == [[], [Fault.P7], [], [Fault.P7], [Fault.P7], []]


@pytest.mark.fault("P15")
@pytest.mark.usefixtures("log")
def test_flood_of_events_is_a_fault(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """P15 is reported while the log drops lines of a kind."""
    found = []
    housekeeping = Housekeeping(bench.link)
    event = StageEvent(5, "warning", "fault", "spike", "S4", "x", nan, nan)
    for _ in range(MAX_LINES + 1):
        EventWriter(bench.loop.shared).append(event)
        found.append(bench.reported())
        housekeeping.log_events()
    flooded = bench.reported()
    after_s = time.monotonic() + WINDOW_S
    monkeypatch.setattr(log_limit(), "_now_s", lambda: after_s)

    assert found == [[]] * (MAX_LINES + 1)
    assert flooded == [Fault.P15]
    assert bench.reported() == []
    asyncio.run(housekeeping.close())


@pytest.mark.fault("P11")
def test_changed_configuration_file_is_a_fault(bench: Bench) -> None:
    """P11 is reported until the file in force is that on the disk, as after a reload."""
    changed = iter([False, True, False])
    bench.link = bench.new_link(config_changed=lambda: next(changed))
    found = []
    for _ in range(3):
        asyncio.run(bench.link.look_at_config())
        found.append(bench.reported())

    assert found == [[], [Fault.P11], []]


def log_limit() -> EventRateLimit:
    """Return the limit of the log."""
    steps = structlog.get_config()["processors"]
    (limit,) = [step for step in steps if isinstance(step, EventRateLimit)]
    return limit


def test_housekeeping_reports_faults(bench: Bench) -> None:
    """The loop gets the faults of the supervisor while the stage runs."""
    bench.link.parameters.rejected = True

    async def until_reported() -> None:
        running = asyncio.create_task(Housekeeping(bench.link).run())
        async with asyncio.timeout(60):
            while not bench.loop.shared.words[Word.SUPERVISOR_FAULTS]:
                await asyncio.sleep(0.01)
        running.cancel()

    asyncio.run(until_reported())

    assert bench.loop.shared.words[Word.SUPERVISOR_FAULTS] == 1 << SUPERVISOR_FAULTS.index(Fault.D8)
    asyncio.run(Housekeeping(bench.link).close())


def test_recording_on_request(bench: Bench) -> None:
    """A recording is listed as running, and after its end as finished."""
    started = bench.do(lambda link: link.start_recording(None, PEER))
    before = bench.do(lambda link: link.recordings())
    stopped = bench.do(lambda link: link.stop_recording(PEER))
    after = bench.do(lambda link: link.recordings())
    asyncio.run(Housekeeping(bench.link).close())

    assert before.running is not None
    assert (before.running.name, before.recordings) == (started.name, ())
    assert (stopped.name, stopped.records) == (started.name, 0)
    assert after.running is None
    assert [file.name for file in after.recordings] == [started.name]
