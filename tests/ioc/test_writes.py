"""What clients write arrives at the daemon, and what it refuses is reported."""

import asyncio
from collections.abc import Coroutine, Iterator
from typing import Any

import pytest

from piezod.client.facts import AxisFacts
from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.config.waveforms.swings import SWINGS
from piezod.errors import RefusedError
from piezod.ioc.axis_motor import AxisMotor
from piezod.ioc.readings import OK, REFUSED
from piezod.ioc.records import Names
from piezod.ioc.table import AXIS_RECORDS, STAGE_RECORDS, WAVES, Kind, Record
from piezod.ioc.writes import Writes
from tests.gcs.fake_stage import FakeLink, FakeStage
from tests.ioc.fakes import FakeMotor, FakeRecords, axis


class Bench:
    """A stage with the axes x and y behind its records."""

    def __init__(self) -> None:
        self.stage = FakeStage("x", "y")
        self.records, self.names = FakeRecords(), Names("p:", ("x", "y"))
        self.raw = {name: FakeMotor() for name in self.names.axes}
        self.motors = {name: AxisMotor(raw, has_sensor=True) for name, raw in self.raw.items()}
        self.reports: list[str] = []
        for motor in self.motors.values():
            motor.limit(AxisFacts((0.0, 20.0), 100.0))
            motor.feed("RUN", axis(on_target=True))
        for name, record in self.names.all():
            if record.kind.is_set:
                self.records.settings[name] = record.start
        self._runner = asyncio.Runner()
        self.writes = self._runner.run(self._made())

    async def _made(self) -> Writes:
        self.mirror = StageMirror(FakeLink(self.stage, "ioc"))
        mover, report = StageMover(self.mirror.link), self.reports.append
        return Writes(self.mirror, mover, self.names, self.records, self.motors, report)

    def run(self, work: Coroutine[Any, Any, bool]) -> bool:
        """Carry out a write."""
        return self._runner.run(work)

    def put(self, axis: str, field: str, value: float) -> bool:
        """Write a field of a motor record, and let the daemon answer."""

        async def put() -> bool:
            accepted = await asyncio.to_thread(self.writes.put, axis, field, value)
            for _ in range(20):
                await asyncio.sleep(0)
            return accepted

        return self._runner.run(put())

    def close(self) -> None:
        """Close the event loop."""
        self._runner.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    """Return a stage with its records."""
    bench = Bench()
    yield bench
    bench.close()


def test_target_is_a_movement_with_the_speed_of_the_record(bench: Bench) -> None:
    """A write to VAL is a `goto`."""
    bench.raw["x"].fields["VELO"] = 30.0

    assert bench.put("x", "VAL", 5.0)
    assert bench.stage.do("goto") == [{"position_um": 5.0, "axis": "x", "speed_um_per_s": 30.0}]
    assert bench.raw["x"].fields["DMOV"] == 0
    assert bench.raw["x"].alarm == OK


@pytest.mark.parametrize(("field", "target_um"), [("TWF", 1.5), ("TWR", 0.5)])
def test_tweak_is_a_movement(bench: Bench, field: str, target_um: float) -> None:
    """It goes from the target by the size of the tweak; a write of 0 does nothing."""
    bench.raw["x"].fields["TWV"] = 0.5
    assert bench.put("x", field, 0.0)
    assert bench.stage.do("goto") == []

    assert bench.put("x", field, 1.0)
    assert bench.stage.do("goto")[0]["position_um"] == target_um


def test_write_beyond_the_limits_does_not_reach_the_daemon(bench: Bench) -> None:
    """It is refused, with range and alarm."""
    assert not bench.put("x", "VAL", 20.5)
    assert bench.stage.requests == []
    assert bench.raw["x"].alarm == REFUSED
    assert bench.reports == ["p:x.VAL: 20.5 um, allowed range 0 to 20 um"]
    assert bench.records.readings["p:MESSAGE"].value == "x.VAL: 20.5 um, allowed range 0 to 20 um"
    assert not bench.put("x", "VELO", 101.0)


def test_refusal_of_the_daemon_gives_the_target_back(bench: Bench) -> None:
    """The record has the target that it had, and an alarm."""
    bench.stage.errors["goto"] = RefusedError("cannot move", "arm", "refused")

    assert bench.put("x", "VAL", 5.0)
    assert (bench.raw["x"].fields["VAL"], bench.raw["x"].fields["DMOV"]) == (1.0, 1)
    assert bench.raw["x"].alarm == REFUSED
    assert bench.reports == ["p:x.VAL: cannot move; arm"]


def test_stop_holds_and_resumes(bench: Bench) -> None:
    """The stage can move again after a stop; one that was not in RUN stays as it is."""
    bench.stage.state = bench.mirror.state = "RUN"
    bench.put("x", "STOP", 1.0)
    running = bench.stage.paths()
    bench.mirror.state = "HOLD"
    bench.put("x", "STOP", 1.0)

    assert running == ["hold", "resume"]
    assert bench.stage.paths() == ["hold", "resume", "hold"]


def test_stop_drops_targets_that_have_not_begun(bench: Bench) -> None:
    """Neither a dropped target nor the one before it is left in VAL; DMOV rises once."""
    bench.stage.state = bench.mirror.state = "RUN"
    motor, raw = bench.motors["x"], bench.raw["x"]
    assert bench.put("x", "VAL", 5.0)
    held = bench.stage.held["goto"] = asyncio.Event()
    assert bench.put("x", "VAL", 6.0)
    assert bench.put("x", "VAL", 7.0)
    assert bench.put("x", "STOP", 1.0)
    held.set()
    for _ in range(5):
        bench.put("x", "TWF", 0.0)  # meanwhile the daemon answers
    motor.feed("HOLD", axis(3.0, None, motion=2))

    assert [each["position_um"] for each in bench.stage.do("goto")] == [5.0, 6.0]
    assert bench.stage.paths()[-1] == "resume"
    assert (raw.fields["VAL"], raw.alarm.severity) == (3.0, 1)
    assert raw.done == [0.0, 1.0]
    assert bench.reports == []


def test_stop_of_a_disarmed_stage_is_no_error(bench: Bench) -> None:
    """Nothing is driven, and nothing is reported."""
    bench.mirror.state = "SAFE"

    assert bench.put("x", "STOP", 1.0)
    assert bench.reports == []


def test_every_command_is_sent(bench: Bench) -> None:
    """Each record of the table that acts sends one request."""
    bench.stage.state = "RUN"
    bench.records.settings["p:x:PLAY:TABLE"] = [0.0, 1.0]
    acting = [
        (axis, each.name)
        for axis, table in (("", STAGE_RECORDS), ("x", AXIS_RECORDS))
        for each in table
        if each.kind.is_set and not each.saved and each.name != "PLAY:READ"
    ]
    for axis_name, name in acting:
        before = len(bench.stage.requests)
        assert bench.run(bench.writes.do(axis_name, name, 1)), name
        assert len(bench.stage.requests) == before + 1, name
    assert len(acting) == 15


def test_waveform_of_the_settings(bench: Bench) -> None:
    """A sine, or the points of a table, for the time of the settings."""
    settings = bench.records.settings
    settings |= {"p:x:WAVE:LOW": 2.0, "p:x:WAVE:HIGH": 4.0, "p:x:WAVE:DURATION": 3.0}
    bench.run(bench.writes.do("x", "WAVE:START", 1))
    settings |= {"p:x:WAVE:KIND": 2, "p:x:WAVE:TABLE": [1.0, 2.0], "p:x:WAVE:INTERVAL": 0.5}
    bench.run(bench.writes.do("x", "WAVE:START", 1))
    settings["p:x:WAVE:TABLE"] = []
    empty = bench.run(bench.writes.do("x", "WAVE:START", 1))
    sine, points = bench.stage.do("wave")

    assert sine["duration_s"] == 3.0
    assert sine["command_um"]["x"]["kind"] == "sine"
    assert (sine["command_um"]["x"]["low"], sine["command_um"]["x"]["high"]) == (2.0, 4.0)
    assert [list(each) for each in points["command_um"]["x"]["points"]] == [[0.0, 1.0], [0.5, 2.0]]
    assert points["duration_s"] == 1.0
    assert not empty
    assert "WAVE:TABLE is empty" in bench.reports[-1]


@pytest.mark.parametrize("kind", SWINGS)
def test_swing_of_the_settings(bench: Bench, kind: str) -> None:
    """Each kind of swing has its numbers from the settings, which begin with values that fit."""
    bench.records.settings["p:x:WAVE:KIND"] = WAVES.index(kind)
    bench.run(bench.writes.do("x", "WAVE:START", 1))
    (body,) = bench.stage.do("wave")

    assert body["command_um"]["x"].items() >= {"kind": kind, "low": 0.0, "high": 1.0}.items()
    numbers = {each.key: each.start for each in SWINGS[kind]}
    assert body["command_um"]["x"].items() >= numbers.items()


def test_refused_command_is_reported(bench: Bench) -> None:
    """The message names the record, and has the reason of the daemon."""
    bench.stage.errors["arm"] = RefusedError("there are faults", "reset", "refused")

    assert not bench.run(bench.writes.do("", "ARM", 1))
    assert bench.records.readings["p:MESSAGE"].value == "ARM: there are faults; reset"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("VAL", float("nan")),
        ("VAL", 1e306),
        ("TWV", float("inf")),
        ("TWV", -1e6),
        ("VELO", float("nan")),
        ("SPMG", 4.0),
        ("SPMG", -1.0),
        ("STOP", 7.0),
        ("TWF", -1.0),
    ],
)
def test_what_no_axis_has_is_refused(bench: Bench, field: str, value: float) -> None:
    """Each field of a motor record that clients write has a range, a menu, or is a button."""
    assert not bench.put("x", field, value)
    assert bench.stage.requests == []
    assert "allowed range" in bench.reports[0]


@pytest.mark.parametrize(
    "record", [each for each in (*STAGE_RECORDS, *AXIS_RECORDS) if each.kind.is_set]
)
def test_each_record_that_clients_write_refuses_what_it_cannot_be(record: Record) -> None:
    """What is not finite, no choice, beyond the range or too long; texts are cut by EPICS."""
    if record.kind is Kind.SET_TEXT:
        return
    table = record.kind is Kind.SET_ARRAY
    good, *wrong = [record.start or 1, float("nan"), float("inf"), -1e7, 1e7, 1e306]
    if record.kind in {Kind.SET_CHOICE, Kind.COMMAND}:
        wrong += [-1, len(record.choices) or 2]
    assert record.why_not([good] * record.length if table else good) == ""
    for value in wrong:
        assert record.why_not([good, value] if table else value), value
    assert not table or record.why_not([good] * (record.length + 1))
