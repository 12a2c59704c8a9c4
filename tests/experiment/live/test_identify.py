"""Tests of the identification of a running stage: its drive and its record."""

from pathlib import Path

import numpy as np
import pytest

from piezod.config.model_file import load_model
from piezod.config.states import State
from piezod.config.waveforms.combined import Sequence
from piezod.errors import ConfigError, DataError, LatenessError, NotReachedError, RefusedError
from piezod.experiment.fit.recorded import on_cycles
from piezod.experiment.live.drive import designed_drive, from_rest, read_drive
from piezod.experiment.live.identify import adopt_live, columns_of, record_live
from piezod.experiment.live.setup import LiveAxis, read_setup
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry
from tests.experiment.live_fakes import MODEL, FakeStage, stage_document

DRIVE = """\
identification:
  method: lms
  settle_s: 1
  run_in_s: 0.5
  duration_s: 2
  drive_v: {kind: sine, low: 0, high: 100, frequency_hz: 1}
"""


def axis(**limits: object) -> LiveAxis:
    """Return axis x of the stage in the repository, with other limits."""
    document = stage_document()
    document["axes"]["x"]["limits"] |= limits
    document["axes"]["x"]["safety"] = {"safe_v": limits.get("rest_v", 0.0), "ramp_v_per_s": 50.0}
    return read_setup(FakeStage(document)).axes["x"]


def test_designed_drive_covers_all_voltages() -> None:
    """It is the drive that the command recommends for a poor record."""
    drive = designed_drive(axis())

    waveform = drive.drive_v.built(drive.duration_s)
    values_v = np.array(waveform.sample(np.linspace(0.0, drive.duration_s, 8001)))
    assert (drive.duration_s, drive.run_in_s, drive.settle_s) == (80.0, 8.0, 5.0)
    assert values_v.min() == pytest.approx(0.0, abs=0.01)
    assert values_v.max() == pytest.approx(150.0, abs=0.01)


def test_drive_from_rest_is_unchanged() -> None:
    """A drive that starts at the rest voltage needs no ramp."""
    designed = designed_drive(axis())

    assert from_rest(designed, axis()).drive_v is designed.drive_v


@pytest.mark.parametrize("designed", [True, False])
def test_drive_from_another_voltage_has_a_ramp(tmp_path: Path, designed: bool) -> None:
    """A stage that rests in the middle does not jump to the end of its range."""
    there = axis(rest_v=60.0)
    (tmp_path / "drive.yaml").write_text(DRIVE, encoding="utf-8")
    settings = designed_drive(there) if designed else read_drive(tmp_path / "drive.yaml")

    drive = from_rest(settings, there)

    assert isinstance(drive.drive_v, Sequence)
    value_v = drive.drive_v.built(drive.duration_s).value
    assert [value_v(t_s) for t_s in (0.0, 0.6, 1.2)] == pytest.approx([60.0, 30.0, 0.0], abs=0.01)
    assert drive.duration_s == settings.duration_s + 1.2
    assert drive.run_in_s == settings.run_in_s + 1.2
    assert value_v(1.2 + 0.5) == pytest.approx(
        settings.drive_v.built(settings.duration_s).value(0.5), abs=0.01
    )


def test_drive_is_read_from_an_experiment(tmp_path: Path) -> None:
    """Other keys of the file do not matter; errors of the drive have their place."""
    path = tmp_path / "drive.yaml"
    path.write_text("title: anything\n" + DRIVE, encoding="utf-8")
    assert read_drive(path).duration_s == 2.0

    path.write_text(DRIVE.replace("high: 100", "high: -1"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"drive.yaml:6:\d+: identification.drive_v.high: "):
        read_drive(path)

    path.write_text("title: anything\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="there is no `identification:`"):
        read_drive(path)


def telemetry() -> RecordedTelemetry:
    """Return a recording at 100 Hz: 1 s armed, 10 s driven, 1 s armed."""
    states = [State.READY] * 100 + [State.IDENT] * 1000 + [State.READY] * 100
    names = tuple(State)
    t_s = 0.01 * np.arange(1200)
    cycles = {
        "t_s": t_s,
        "late_ns": np.zeros(1200, np.int64),
        "state": np.array([names.index(state) for state in states]),
    }
    columns = {"in_force_v": 10.0 * t_s, "position_um": 2.0 * t_s}
    header = TelemetryHeader("t", ("x",), 100.0, "", 0, {"state": names})
    return RecordedTelemetry(header, 0, np.empty((0, 2), np.int64), cycles, {"x": columns}, {})


def test_record_contains_the_drive() -> None:
    """It covers the first to the last cycle of the drive, with the voltage in force."""
    columns, warnings = columns_of(telemetry(), "x")

    assert warnings == ()
    assert columns["t_s"] == pytest.approx(0.01 * np.arange(1000))
    assert columns["drive_v"] == pytest.approx(10.0 + 10.0 * columns["t_s"])
    assert columns["position_um"] == pytest.approx(2.0 + 2.0 * columns["t_s"])


def test_few_missing_samples_are_filled_in() -> None:
    """Skipped cycles and invalid samples are filled in, and counted in a warning."""
    recorded = telemetry()
    recorded.axes["x"]["position_um"][500:505] = np.nan
    for columns in (recorded.cycles, recorded.axes["x"]):
        for name, column in columns.items():
            columns[name] = np.delete(column, slice(700, 703))

    filled, (warning,) = columns_of(recorded, "x")

    assert filled["t_s"].size == 1000
    assert filled["position_um"] == pytest.approx(2.0 + 2.0 * filled["t_s"])
    assert warning.startswith("8 of 1000 samples were missing")


def test_many_missing_samples_are_refused() -> None:
    """A record of a sensor out of its range gives no model of the stage."""
    recorded = telemetry()
    recorded.axes["x"]["position_um"][500:600] = np.nan

    with pytest.raises(DataError, match="axis x: 100 of 1000 samples are missing"):
        columns_of(recorded, "x")


def test_recording_without_a_drive_is_refused() -> None:
    """The state marks the cycles of the drive."""
    recorded = telemetry()
    recorded.cycles["state"][:] = 0

    with pytest.raises(DataError, match="does not contain the drive"):
        columns_of(recorded, "x")


def record(stage: FakeStage, name: str | None = None) -> None:
    """Identify an axis of a stage."""
    record_live(stage, Path("no.csv"), lambda _label, _share: None, axis=name, settings=None)


def test_axis_must_be_named_if_there_are_several() -> None:
    """One axis is identified at a time, while the others rest."""
    document = stage_document()
    document["axes"]["y"] = document["axes"]["x"]

    with pytest.raises(DataError, match="several axes, x, y: name one with --axis"):
        record(FakeStage(document))
    with pytest.raises(DataError, match="no axis z; its axes are x, y"):
        record(FakeStage(document), "z")


def test_axis_without_a_sensor_is_not_identified() -> None:
    """It is refused before anything moves."""
    stage = FakeStage(stage_document(sensor=None))

    with pytest.raises(DataError, match="axis x has no sensor, and an identification needs one"):
        record(stage)
    assert "arm" not in stage.asked


def test_fault_while_driving_stops_the_stage() -> None:
    """The stage is disarmed, and there is no record."""

    def fault(stage: FakeStage) -> None:
        if stage.state == "IDENT":
            stage.state, stage.present = "HOLD", ("S1",)

    stage = FakeStage()
    stage.each = fault

    with pytest.raises(NotReachedError, match="in HOLD because of S1"):
        record(stage)

    assert stage.asked[-3:] == ["stop", "recordings/stop", "end of the session"]


def late(stage: FakeStage, times: int) -> None:
    """Have the loop of a stage late in its drive, a number of times: it holds, and goes on."""
    left = times

    def each(stage: FakeStage) -> None:
        nonlocal left
        if stage.state == "IDENT" and left:
            left -= 1
            stage.state, stage.present, stage.skipped = "HOLD", ("L2", "S5"), stage.skipped + 30
        elif stage.state == "HOLD":
            stage.state, stage.present = "READY", ()

    stage.each = each


def test_drive_is_repeated_when_the_loop_was_late() -> None:
    """It begins anew, from rest, when the cycles are punctual again."""
    stage, begun = FakeStage(), 2
    late(stage, begun)

    stage.refused["recordings/stop"] = "no recording here"

    with pytest.raises(RefusedError, match="no recording here"):
        record(stage)

    assert stage.asked.count("identify") == begun + 1
    assert stage.asked.count("recordings/start") == begun + 1


def test_loop_that_stays_late_is_the_reason() -> None:
    """The sensor is not blamed for a stage in HOLD."""
    stage = FakeStage()
    late(stage, 99)

    with pytest.raises(LatenessError, match=r"^the computer was late: 90 of"):
        record(stage)

    assert stage.asked[-3:] == ["stop", "recordings/stop", "end of the session"]


def test_cycles_that_the_loop_skipped_are_not_the_sensors() -> None:
    """A record that lacks too many says which."""
    recorded = telemetry()
    for columns in (recorded.cycles, recorded.axes["x"]):
        for name, column in columns.items():
            columns[name] = np.delete(column, slice(500, 600))

    with pytest.raises(LatenessError, match="the computer was late"):
        columns_of(recorded, "x")


def test_model_is_adopted_disarmed() -> None:
    """A stage takes a model in SAFE only."""
    stage = FakeStage()
    stage.state = "RUN"

    adopt_live(stage, "x", load_model(MODEL))

    assert stage.asked.index("stop") < stage.asked.index("model")
    body = stage.bodies[stage.asked.index("model")]
    assert body is not None
    assert body["axis"] == "x"


def test_fast_changes_are_placed_by_cycles() -> None:
    """No sample is interpolated to its deadline; skipped cycles take the voltage in force."""
    recorded = telemetry()
    recorded.cycles["late_ns"][:] = 4_000_000
    recorded.cycles["t_s"] += 0.004
    for columns in (recorded.cycles, recorded.axes["x"]):
        for name, column in columns.items():
            columns[name] = np.delete(column, slice(700, 702))

    placed, _ = columns_of(recorded, "x", on_cycles)

    kept = np.r_[0:600, 602:1000]
    assert (
        placed["position_um"][kept].tolist() == recorded.axes["x"]["position_um"][100:1098].tolist()
    )
    assert placed["drive_v"][600:602].tolist() == [placed["drive_v"][602]] * 2
    assert placed["t_s"] == pytest.approx(0.01 * np.arange(1000))
