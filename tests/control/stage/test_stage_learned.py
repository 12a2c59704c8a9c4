"""Tests of learned models on the simulated rig: good ones, bad ones, pairs that do not fit."""

from typing import Any

import numpy as np
import pytest

from piezod.config.axes import CompensatorConfig
from piezod.config.daemon import DaemonConfig
from piezod.config.faults import Fault
from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.control.assembly import check_stage
from piezod.control.law.identifier import LearningGate
from piezod.control.law.learned_models import LEAST_ERROR
from piezod.errors import ModelError
from piezod.hysteresis import even_thresholds
from piezod.messages import requests as rq
from piezod.testing.injections import InjectionKind
from tests.conftest import Reaction
from tests.control.rig_stage import FaultyStage, RigStage, shipped_config, with_axis
from tests.control.surface_rig import CLASSES, with_model

RANGE_UM = 31.3
ACCURATE = [*CLASSES, pytest.param("path", marks=pytest.mark.stress)]
"""Models with which a fast move in feedforward ends at its target."""


def with_compensator(compensator: dict[str, Any], rate_hz: float = 500.0) -> DaemonConfig:
    """Return the shipped configuration, whose model is graded, with this compensator.

    Its learned model may be far from the identified one.
    """
    config = shipped_config()
    settings = CompensatorConfig.model_validate({"learned_pct": 30.0, **compensator})
    return with_axis(config, compensator=settings).model_copy(update={"rate_hz": rate_hz})


def running(config: DaemonConfig, mode: Mode = Mode.ADAPTIVE) -> RigStage:
    """Return a stage in RUN."""
    return RigStage(config).armed(rq.SelectMode(mode=mode))


def error_um(stage: RigStage, position_um: float) -> float:
    """Move to a position; return the mean error after one and a half seconds, in µm."""
    stage.do(rq.Goto(position_um=position_um))
    records = stage.run(1.5)
    return float(np.mean([each.axes[0].position_um for each in records[-50:]])) - position_um


def learn_wrong(stage: RigStage, duration_s: float) -> float:
    """Use a model with an offset of a tenth for a time, at 13 µm; return the worst error, in µm."""
    identifier = stage.stage.axes[0].law.identifier
    identifier.adaptation.adopt(identifier.weights, offset=0.1)
    stage.do(rq.SelectMode(mode=Mode.ADAPTIVE))
    return max(abs(each.axes[0].position_um - 13.0) for each in stage.run(duration_s))


@pytest.fixture
def learns_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the learned model as it is: a good identifier would soon correct it."""
    admits = LearningGate.admits

    def refuses(gate: LearningGate, **sample: Any) -> bool:
        return admits(gate, **sample) and False

    monkeypatch.setattr(LearningGate, "admits", refuses)


def test_default_identifier_fits_the_model_that_identify_makes() -> None:
    """Without `compensator` a move of an adaptive stage ends at its target."""
    stage = running(with_compensator({}))

    assert abs(error_um(stage, 13.0)) < LEAST_ERROR * RANGE_UM
    assert not stage.faults()


@pytest.mark.parametrize("identifier", ["lms", "nlms"])
def test_lms_is_refused_with_the_thresholds_of_the_model_file(identifier: str) -> None:
    """The model file counts, not only the keys of the configuration."""
    with pytest.raises(ModelError, match=rf"^axis x: identifier {identifier} needs even .*rls"):
        check_stage(with_compensator({"identifier": identifier}))


def test_lms_is_refused_with_the_thresholds_of_an_adopted_model() -> None:
    """The stage keeps the model that it has; a model with even thresholds is accepted."""
    config = with_compensator({"identifier": "lms"})
    file = config.axes["x"].model
    assert file is not None
    graded, stage = load_model(file), RigStage(with_axis(config, model=None))
    stage.until("SAFE")
    even = tuple(even_thresholds(19).tolist())

    refused = stage.ask(rq.AdoptModel(model=graded))
    thresholds = {"right_stop_thresholds": even, "left_stop_thresholds": even}
    weights = {"right_stop_weights": (0.01,) * 19, "left_stop_weights": (0.01,) * 19}
    accepted = stage.ask(rq.AdoptModel(model=graded.model_copy(update=thresholds | weights)))

    assert not refused.accepted
    assert "identifier lms needs even thresholds" in refused.why
    assert "`identifier: rls`" in refused.why
    assert accepted.accepted, accepted.why


@pytest.mark.fault("D1")
@pytest.mark.usefixtures("learns_nothing")
@pytest.mark.parametrize("model", ACCURATE)
def test_learned_model_that_is_worse_is_a_fault_and_is_dropped(
    model: str, reaction: Reaction
) -> None:
    """The stage degrades to the identified model and arrives, although it was off in RUN."""
    stage = running(with_model(with_compensator({}, rate_hz=1000.0), model), Mode.FEEDFORWARD)
    stage.do(rq.Goto(position_um=13.0))
    stage.run(1.5)

    before_ns = stage.t_ns
    worst_um = learn_wrong(stage, 1.5)

    assert worst_um > 5 * LEAST_ERROR * RANGE_UM
    assert stage.faults() == ["D1"]
    reaction("D1", cycles=stage.cycles_to(Fault.D1, before_ns))
    assert (stage.state, stage.x.mode) == ("RUN", Mode.FEEDFORWARD)
    assert abs(error_um(stage, 13.0)) < LEAST_ERROR * RANGE_UM
    assert stage.stage.axes[0].law.identifier.offset == 0.0


@pytest.mark.usefixtures("learns_nothing")
def test_mode_feedforward_goes_back_to_a_proven_model_at_once() -> None:
    """A model that has not yet proved itself is not kept."""
    stage = running(with_compensator({}), Mode.FEEDFORWARD)
    stage.do(rq.Goto(position_um=13.0))
    stage.run(1.5)
    worst_um = learn_wrong(stage, 0.5)

    stage.do(rq.SelectMode(mode=Mode.FEEDFORWARD))
    stage.run(0.3)

    assert worst_um > 5 * LEAST_ERROR * RANGE_UM
    assert abs(stage.x.position_um - 13.0) < LEAST_ERROR * RANGE_UM
    assert not stage.faults()


def test_proven_model_stays_when_learning_ends() -> None:
    """Weights that have improved the stage for a second are kept in mode `feedforward`."""
    stage = running(with_compensator({}))
    for position_um in (20.0, 2.0) * 2:
        error_um(stage, position_um)
    law = stage.stage.axes[0].law
    proven = law.proof.proven.weights.copy()

    stage.do(rq.SelectMode(mode=Mode.FEEDFORWARD))
    stage.run(0.3)

    assert np.max(np.abs(proven - law.proof.first.weights)) > 1e-6
    np.testing.assert_allclose(law.compensator.weights, proven, rtol=1e-12)
    assert law.compensator.offset == pytest.approx(law.proof.proven.offset)


@pytest.mark.fault("D2")
@pytest.mark.usefixtures("learns_nothing")
@pytest.mark.parametrize("model", ACCURATE)
def test_weights_that_are_nan_do_not_outlive_their_mode(model: str, reaction: Reaction) -> None:
    """The stage degrades to the identified model, and still moves to its target."""
    stage = running(with_model(with_compensator({}), model))
    error_um(stage, 13.0)

    before_ns = stage.t_ns
    stage.stage.axes[0].law.identifier.weights[3] = np.nan
    records = stage.run(0.5)

    assert "D2" in stage.faults()
    reaction("D2", cycles=stage.cycles_to(Fault.D2, before_ns))
    assert stage.x.mode is Mode.FEEDFORWARD
    assert all(np.isfinite(each.axes[0].drive_v) for each in records)
    assert abs(error_um(stage, 8.0)) < LEAST_ERROR * RANGE_UM


@pytest.mark.fault("S3")
def test_impossible_position_at_rest_spoils_nothing() -> None:
    """In SAFE it is no fault; it made a creep of many ranges, and wrong weights were learned."""
    stage = FaultyStage()
    stage.until("SAFE")
    stage.fail(InjectionKind.REPLACED, 1000, value=-500.0)
    stage.run(6.0)
    stage.do(rq.Arm(), rq.SelectMode(mode=Mode.ADAPTIVE))
    sine = Sine(kind="sine", low=1.0, high=15.0, frequency_hz=0.3)
    stage.do(rq.Wave(command_um={"x": sine}, duration_s=100.0))
    axes = [each.axes[0] for each in stage.run(10.0)]

    assert stage.faults() == []
    error_um = [axis.command_um - axis.position_um for axis in axes]
    assert np.sqrt(np.mean(np.square(error_um))) < 0.005 * RANGE_UM
