"""A waveform that is learned on a running stage, as a program of Python does it."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.config.fields import Context
from piezod.config.model_file import ModelFile, load_model
from piezod.config.play import WaveConfig
from piezod.errors import ConfigError, DataError, RefusedError
from piezod.experiment.live.play import REST_S, learn_waveform
from piezod.experiment.live.running_axis import RunningAxis
from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.command import points_of
from piezod.experiment.play.learn import PassReport
from piezod.experiment.play.response import LOWEST_HZ, usual_multisine
from piezod.hysteresis import SurfaceForm
from tests.config.test_surface_file import FILE
from tests.control.made_up import RELAXING
from tests.experiment.live.playing_stage import WAVE, PlayingStage
from tests.experiment.live_fakes import MODEL, FakeStage

RANGES = {"drive_low_v", "drive_high_v", "position_low_um", "position_high_um"}
BRIEF: dict[str, Any] = {"settle_s": 0.3, "record_s": 0.2}


@pytest.mark.parametrize("interval_us", [24, 50, 240, 650])
def test_multisine_has_a_whole_number_of_points(interval_us: int) -> None:
    """Its lowest frequency is near 10 Hz, also for a clock that does not divide 0.1 s."""
    interval_ns = 1000 * interval_us
    frequency_hz = usual_multisine(interval_ns, 0.01).lowest_hz

    assert frequency_hz == pytest.approx(LOWEST_HZ, rel=0.01)
    assert points_of("the multisine", 1.0 / frequency_hz, interval_ns) > 100


def test_waveform_is_learned_and_the_stage_disarmed() -> None:
    """The response is measured, the error falls from pass to pass, and each pass is reported."""
    stage, reported = PlayingStage(response=None), list[PassReport]()

    learned = learn_waveform(stage, WAVE, 2, **BRIEF, report=reported.append)

    labels = ["inverse and response", "pass 1", "pass 2"]
    assert [each.label for each in learned.reports] == labels
    assert reported == list(learned.reports)
    first, _, last = (each.measured.max_pct for each in learned.reports)
    assert last < 0.3 * first
    assert learned.best is learned.reports[-1]
    assert learned.given.name == "waveform"
    assert stage.asked.count("play") == 1 + 1 + len(labels)  # zero, response, passes
    assert (stage.state, stage.asked[-2:]) == ("SAFE", ["stop", "end of the session"])


class SmallBodies(PlayingStage):
    """A stage that takes short tables only, as a daemon limits the size of a request."""

    def _play(self, body: Mapping[str, Any]) -> None:
        if len(json.dumps(body)) > 8000:
            raise RefusedError("the body is too long", "", "too_large")
        super()._play(body)


def test_table_that_fits_into_no_request_is_named() -> None:
    """A smaller amplitude does not make it shorter: none is tried, and the remedy is told."""
    stage = SmallBodies(response=None)

    with pytest.raises(DataError, match=r"too long; a longer interval .* makes it smaller"):
        learn_waveform(stage, WAVE, 2, **BRIEF)

    assert stage.asked.count("play") <= 2  # that of the zero, and one


def test_learned_table_is_stored_and_used_again(tmp_path: Path) -> None:
    """The next call begins with it; its waveform may be a mapping or a model of the file."""
    notes = list[str]()
    model = WaveConfig.model_validate({"name": "scan", **WAVE}, context=Context())

    for wave in (model, {"name": "scan", **WAVE}):
        learned = learn_waveform(
            PlayingStage(), wave, 0, **BRIEF, tables=tmp_path, note=notes.append
        )

    assert [each.label for each in learned.reports] == ["stored table"]
    assert notes[0] == f"no table of this waveform in {tmp_path}"
    assert notes[1::2] == ["stored as table_x_scan.yaml"] * 2
    assert notes[2].startswith("begins with table_x_scan.yaml, learned on ")


def test_path_of_the_model_is_brought_to_rest_first() -> None:
    """A play of some swings through the whole range precedes the zero."""
    stage, known = PlayingStage(), load_model(MODEL)
    assert isinstance(RELAXING.form, SurfaceForm)
    assert RELAXING.form.path
    relaxing = ModelFile.model_validate(
        FILE.model_dump()
        | known.model_dump(include=RANGES)
        | {
            "surface_coefficients": tuple(RELAXING.weights.tolist()),
            "surface_path": asdict(RELAXING.form.path),
        }
    )
    stage.model = relaxing.model_dump(mode="json")

    learn_waveform(stage, WAVE, 0, **BRIEF)

    played = [body for body in stage.bodies if body and "lead_in_v" in body]
    swings, zero = (np.array(body["drive_v"]) for body in played[:2])
    assert np.ptp(swings) == pytest.approx(known.drive_high_v - known.drive_low_v, rel=1e-3)
    assert played[0]["cycles"] == RELAXING.form.cycles_to_rest
    assert np.ptp(zero) == 0.0


def test_armed_stage_is_disarmed_first() -> None:
    """Learning begins in any state of the stage."""
    stage = PlayingStage()
    stage.arm()

    learn_waveform(stage, WAVE, 0, **BRIEF)

    assert stage.state == "SAFE"


def test_exception_between_two_plays_leaves_the_stage_disarmed() -> None:
    """An error of the caller passes on, after the stop."""
    stage = PlayingStage()

    def fail(_report: PassReport) -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        learn_waveform(stage, WAVE, **BRIEF, report=fail)

    assert (stage.state, stage.asked[-2:]) == ("SAFE", ["stop", "end of the session"])


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"wave": {"command_um": {"kind": "reversals"}}}, "learn_waveform: wave.command_um.kind: "),
        ({"wave": {}}, "learn_waveform: wave.command_um: required key is missing"),
        ({"passes": 51}, "learn_waveform: passes: out of range (got 51), allowed range 0 to 50"),
        ({"interval_us": 0.0}, "learn_waveform: interval_us: out of range"),
    ],
)
def test_wrong_argument_is_named_before_anything_moves(changes: dict[str, Any], what: str) -> None:
    """The message has the place in the argument, as that of a file has the line."""
    stage = PlayingStage()

    with pytest.raises(ConfigError) as refused:
        learn_waveform(stage, **{"wave": WAVE, **changes})

    assert str(refused.value).startswith(what)
    assert stage.asked == []


def test_command_out_of_range_is_refused_before_anything_moves() -> None:
    """The message has the range of the axis."""
    stage = PlayingStage()
    sine = {"kind": "sine", "low": 4.0, "high": 99.0, "frequency_hz": 200.0}

    with pytest.raises(DataError, match="commands 4 to 99 µm, but axis x may be commanded from"):
        learn_waveform(stage, {"command_um": sine})

    assert "arm" not in stage.asked


def test_axis_without_a_model_is_refused_before_anything_moves() -> None:
    """The message says which command makes one."""
    stage = PlayingStage()
    stage.model = None

    with pytest.raises(DataError, match="which a table needs; `piezod identify --live"):
        learn_waveform(stage, WAVE)

    assert "arm" not in stage.asked


def test_refused_request_ends_learning() -> None:
    """A refusal of the daemon is raised, and the stage is stopped."""
    stage = PlayingStage()
    stage.refused["play"] = "no device plays"

    with pytest.raises(RefusedError, match="no device plays"):
        learn_waveform(stage, WAVE)

    assert stage.asked[-2:] == ["stop", "end of the session"]


def test_rest_tells_the_time_of_the_daemon() -> None:
    """A drift is told by the times of the plays: those of the clock that drives the stage."""
    client = FakeStage()
    with LiveStage(client, read_setup(client), lambda _s: None) as stage:
        stage.arm()
        axis = RunningAxis(stage, "x", 2.0, REST_S)
        first, second = axis.rest(), axis.rest()

    assert second.t_s - first.t_s == pytest.approx(REST_S, abs=0.11)
    assert second.drive_v == 2.0
