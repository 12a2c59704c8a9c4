"""The flight recorder: the seconds around a fault, without a request."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from piezod.daemon.stores.flight_recorder import AFTER_NS, KEPT, MAX_EVENTS, FlightRecorder
from piezod.records.recording.reader import read_telemetry
from piezod.telemetry.record import StageEvent
from tests.daemon.fake_ring import FakeRing
from tests.records.telemetry import START_NS, header

NOON = datetime(2024, 5, 1, 12, tzinfo=UTC)
CYCLE_NS = 1_000_000


class Stage:
    """A ring that fills as time passes, and a flight recorder that reads it."""

    def __init__(self, folder: Path) -> None:
        self.ring = FakeRing(16_000)
        self.flights = FlightRecorder(self.ring.last, folder, self.now)

    @property
    def t_ns(self) -> int:
        """Instant of the newest record."""
        return START_NS + (self.ring.newest - 1) * CYCLE_NS

    def now(self) -> datetime:
        """Return the time of day of the newest record."""
        return NOON + timedelta(microseconds=(self.t_ns - START_NS) / 1000)

    def take_event(self, kind: str, fault: str = "", severity: str = "error") -> None:
        """Make an event now."""
        self.flights.take_event(
            StageEvent(self.t_ns, severity, kind, f"{kind} µ", fault, "x", 3.0, 2.0)
        )

    def write_due(self) -> Path | None:
        """Write the file if it is due."""
        if not self.flights.is_due(self.t_ns):
            return None
        return self.flights.write_now(header(notes={"configuration": "a: 1"}), self.t_ns)


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    """Return a stage that has run for 20 s."""
    stage = Stage(tmp_path / "flights")
    stage.ring.run(20_000)
    return stage


def test_ten_seconds_before_and_two_after(stage: Stage) -> None:
    """The file has every cycle around the fault, and its time counts from the fault."""
    fault_cycle = stage.ring.newest - 1
    stage.take_event("fault", "S5")
    stage.ring.run(2100)
    path = stage.write_due()
    assert path is not None
    flight = read_telemetry(path)

    np.testing.assert_array_equal(
        flight.cycles["seq"], np.arange(fault_cycle - 10_000, fault_cycle + 2001)
    )
    assert (flight.cycles["t_s"][0], flight.cycles["t_s"][-1]) == (-10.0, 2.0)
    assert path.name == "20240501T120019Z-S5.h5"
    assert flight.header.title == "S5: fault µ"
    assert flight.header.started_at == "2024-05-01T12:00:19.999+00:00"


def test_events_are_in_the_file(stage: Stage) -> None:
    """The events around the fault are rows and lines of JSON, beside the notes of the stage."""
    stage.take_event("request", severity="info")
    stage.ring.run(11_000)
    stage.take_event("state", severity="info")
    stage.ring.run(1000)
    stage.take_event("fault", "S5")
    stage.ring.run(500)
    stage.take_event("fault", "A3")
    stage.ring.run(1500)
    path = stage.write_due()
    assert path is not None
    flight = read_telemetry(path)
    notes = flight.header.notes
    events = [json.loads(line) for line in notes["events"].splitlines()]

    assert [(each["kind"], each["fault"]) for each in events] == [
        ("state", ""),
        ("fault", "S5"),
        ("fault", "A3"),
    ]
    assert (events[1]["measured"], events[1]["limit"]) == (3.0, 2.0)
    assert notes["configuration"] == "a: 1"
    assert [each._asdict() for each in flight.events] == events


def test_nothing_is_written_before_its_time(stage: Stage) -> None:
    """A file is due 2 s after the fault, once."""
    before = stage.write_due()
    stage.take_event("fault", "S5")
    stage.ring.run(AFTER_NS // CYCLE_NS - 1)
    early = stage.write_due()
    stage.ring.run(1)
    due = stage.write_due()
    stage.ring.run(1)

    assert (before, early, stage.write_due()) == (None, None, None)
    assert due is not None


@pytest.mark.parametrize(("kind", "severity"), [("fault", "warning"), ("state", "error")])
def test_only_errors_are_written(stage: Stage, kind: str, severity: str) -> None:
    """A warning, or an event that is no fault, makes no file."""
    stage.take_event(kind, "L1", severity)
    stage.ring.run(3000)

    assert stage.write_due() is None


@pytest.mark.fault("P15")
def test_flickering_fault_does_not_fill_the_disk(stage: Stage) -> None:
    """A file is written every 12 s at most, and its number of events is limited."""
    for _ in range(24_000):
        stage.take_event("fault", "S5")
        stage.ring.run(1)
        stage.write_due()
    events = read_telemetry(stage.flights.folder.path / "20240501T120019Z-S5.h5").header.notes

    assert len(stage.flights.folder.files()) == 2
    assert len(events["events"].splitlines()) == MAX_EVENTS


def test_newest_files_are_kept(stage: Stage) -> None:
    """The oldest files are removed."""
    for second in range(KEPT):
        stage.flights.folder.new(NOON - timedelta(seconds=second)).touch()
    stage.take_event("fault", "S5")
    stage.ring.run(2000)
    path = stage.write_due()
    names = [each.name for each in stage.flights.folder.files()]

    assert path is not None
    assert names[0] == path.stem
    assert len(names) == KEPT


def test_flight_of_a_loop_that_has_ended(stage: Stage) -> None:
    """After the end of the loop, the file is written at once."""
    nothing = stage.flights.write_now(header(), stage.t_ns)
    stage.take_event("fault", "P4")
    path = stage.flights.write_now(header(), stage.t_ns)
    assert path is not None

    assert nothing is None
    assert read_telemetry(path).cycles["t_s"][-1] == 0.0
