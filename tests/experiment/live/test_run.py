"""Tests of failures of an experiment on a running stage: it is reported, and the stage stops."""

from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.errors import (
    ClientError,
    DataError,
    NotReachedError,
    NotRunningError,
    PiezodError,
    RefusedError,
)
from piezod.experiment.live.run import run_live
from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import LiveStage
from tests.experiment.conftest import Load
from tests.experiment.live_fakes import FakeStage, stage_document

Failure = Callable[[FakeStage], None]
LEFT = ["stop", "recordings/stop", "end of the session"]
"""Requests at the end, while a recording runs."""


@pytest.fixture
def config(load: Load, short: str) -> ExperimentConfig:
    """Return an experiment of one case in one mode, with a waveform of 3 s."""
    return load(short + "modes: [adaptive]\n")


def run(config: ExperimentConfig, stage: FakeStage) -> None:
    """Run an experiment on a stage."""
    run_live(config, "", "title", stage, lambda _label, _share: None)


def while_moving(failure: Failure) -> Failure:
    """Return a failure that happens while the stage follows the waveform."""

    def each(stage: FakeStage) -> None:
        if stage.motion:
            failure(stage)

    return each


def fault(stage: FakeStage) -> None:
    """Make a fault stop the stage."""
    stage.state, stage.present = "HOLD", ("S5",)


def fall_back(stage: FakeStage) -> None:
    """Make a fault change the mode."""
    stage.mode_now, stage.present = "feedforward", ("S3",)


def move(stage: FakeStage) -> None:
    """Make another client move the stage."""
    stage.motion = 2


def vanish(stage: FakeStage) -> None:
    """Make the daemon end."""
    stage.refused = {}
    raise NotRunningError("the daemon has gone", "is it still running?")


@pytest.mark.parametrize(
    ("failure", "kind", "text"),
    [
        (fault, NotReachedError, "the stage is in HOLD because of S5; see `piezod faults`"),
        (fall_back, NotReachedError, "axis x: the mode has become feedforward because of S3"),
        (move, NotReachedError, "axis x: another movement has taken the place of this one"),
        (vanish, NotRunningError, "the daemon has gone"),
    ],
)
def test_failure_during_a_run_stops_the_stage(
    config: ExperimentConfig, failure: Failure, kind: type[PiezodError], text: str
) -> None:
    """The error names case and mode; the stage stops first, then the recording."""
    stage = FakeStage()
    stage.each = while_moving(failure)

    with pytest.raises(kind) as caught:
        run(config, stage)

    assert str(caught.value).startswith(f"slow, adaptive: {text}")
    assert stage.asked[-3:] == LEFT


@pytest.mark.parametrize("refused", ["mode", "zero", "arm", "recordings/start", "wave"])
def test_refused_request_stops_the_stage(config: ExperimentConfig, refused: str) -> None:
    """The error has case, mode and remedy, and the stage is disarmed."""
    stage = FakeStage()
    stage.refused[refused] = "no"

    with pytest.raises(RefusedError, match=r"^slow, adaptive: no; a remedy$"):
        run(config, stage)

    assert "stop" in stage.asked[stage.asked.index(refused) :]
    assert stage.state == "SAFE"


def test_interrupt_stops_the_stage(config: ExperimentConfig) -> None:
    """Ctrl-C leaves the stage as an error does."""

    def interrupt(_stage: FakeStage) -> None:
        raise KeyboardInterrupt

    stage = FakeStage()
    stage.each = while_moving(interrupt)

    with pytest.raises(KeyboardInterrupt):
        run(config, stage)

    assert stage.asked[-3:] == LEFT


def test_stage_that_cannot_be_stopped_is_reported(config: ExperimentConfig) -> None:
    """The error has the failure, and says that the stage may still be driven."""

    def failure(stage: FakeStage) -> None:
        fault(stage)
        stage.refused["stop"] = "too busy"

    stage = FakeStage()
    stage.each = while_moving(failure)

    with pytest.raises(ClientError) as caught:
        run(config, stage)

    assert "because of S5" in str(caught.value)
    assert "the stage could not be stopped: too busy" in str(caught.value)
    assert "the emergency stop" in caught.value.remedy


def test_stage_of_another_client_is_not_stopped(config: ExperimentConfig) -> None:
    """Without the lease the motion of another client continues."""
    stage = FakeStage()
    stage.refused["session"] = "somebody holds the lease"

    with pytest.raises(RefusedError, match="somebody holds the lease"):
        run(config, stage)

    assert "stop" not in stage.asked


def test_faulty_stage_is_not_run(config: ExperimentConfig) -> None:
    """A latched fault needs a reset by a person."""

    def latched(stage: FakeStage) -> None:
        stage.state, stage.present = "FAULT", ("P2",)

    stage = FakeStage()
    stage.each = latched

    with pytest.raises(NotReachedError, match=r"the stage is in FAULT because of P2"):
        run(config, stage)

    assert "arm" not in stage.asked


def test_recording_that_ends_by_itself_is_an_error(config: ExperimentConfig) -> None:
    """A full disk leaves nothing to judge."""
    stage = FakeStage()
    stage.why = "12 MB are free"

    with pytest.raises(DataError, match=r"^slow, adaptive: .* by itself: 12 MB are free$"):
        run(config, stage)


def test_steps_of_a_run(config: ExperimentConfig) -> None:
    """Rest, zero, mode, arm; the recording covers the whole movement."""
    stage = FakeStage()
    stage.why = "that is enough"

    with pytest.raises(DataError):
        run(config, stage)

    assert stage.asked[:4] == ["GET status", "GET config", "GET params", "session"]
    assert stage.asked[4:] == [
        *("stop", "mode", "zero", "arm", "recordings/start", "mode", "wave", "recordings/stop"),
        *("stop", "end of the session"),
    ]
    bodies = [body for body in stage.bodies if body]
    assert {"label": "slow-adaptive"} in bodies
    assert stage.t_s > 100.0 + 0.5 + 0.5 + 3.0


def test_stage_with_another_safe_voltage_is_driven_to_rest(config: ExperimentConfig) -> None:
    """The zero is at the rest voltage."""
    stage = FakeStage(stage_document(safety={"safe_v": 10.0, "ramp_v_per_s": 50.0}))
    stage.why = "that is enough"

    with pytest.raises(DataError, match="that is enough"):
        run(config, stage)

    at = stage.asked.index("identify")
    assert stage.bodies[at] == {
        "drive_v": {"x": {"kind": "setpoint", "level": 0.0}},
        "duration_s": 0.5,
    }
    assert stage.asked[at - 1] == "arm"


def test_file_is_sent_as_its_points(load: Load, short: str, tmp_path: Path) -> None:
    """A daemon reads no files of its clients."""
    (tmp_path / "path.csv").write_text("t_s,x\n0,0\n1,5\n3,20\n", encoding="utf-8")
    sine = "{kind: sine, low: 0, high: 20, frequency_hz: 1}"
    text = short.replace(sine, "{kind: csv, path: path.csv, column: x}") + "modes: [adaptive]\n"
    stage = FakeStage()
    stage.why = "that is enough"

    with pytest.raises(DataError, match="that is enough"):
        run(load(text), stage)

    body = stage.bodies[stage.asked.index("wave")]
    assert body is not None
    assert body["command_um"]["x"]["kind"] == "points"
    assert [list(point) for point in body["command_um"]["x"]["points"]] == [[0, 0], [1, 5], [3, 20]]


def test_faults_that_concern_no_data_are_no_remark() -> None:
    """Late samples are counted elsewhere; log and configuration file change no sample."""
    client = FakeStage()
    client.present = ("L1", "S6", "P11", "P15")

    with LiveStage(client, read_setup(client), lambda _s: None) as stage:
        stage.disarm()

    assert stage.faults == {"S6"}
