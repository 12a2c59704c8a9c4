"""Tests that no command reaches a trim whose gain is not safe."""

from typing import Any

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.first_mode import FoundModeConfig
from piezod.config.model_file import load_model
from piezod.config.modes import Mode
from piezod.config.trim import TrimConfig
from piezod.control.assembly import check_stage
from piezod.errors import ModelError
from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, shipped_config, with_axis

GREEDY = {"gain_per_s": 5000.0, "authority_pct": 20.0}
REFUSED = r"^axis x: a trim gain of 5000 1/s is not safe: .*; use at most \d+ 1/s$"


def with_trim(trim: dict[str, Any], rate_hz: float, mode: Mode = Mode.FEEDFORWARD) -> DaemonConfig:
    """Return the shipped configuration with this trim."""
    config = with_axis(shipped_config(), trim=TrimConfig.model_validate(trim))
    return config.model_copy(update={"rate_hz": rate_hz, "mode": mode})


def test_unsafe_gain_is_told_at_the_start() -> None:
    """The stage does not start in that mode; in another mode it says that it will refuse this."""
    stage = RigStage(with_trim(GREEDY, 200.0))
    stage.until("SAFE")
    (event,) = (each for each in stage.events if each.kind == "trim")

    check_stage(stage.config)
    with pytest.raises(ModelError, match=REFUSED):
        check_stage(with_trim(GREEDY, 200.0, Mode.TRIMMED))
    assert event.axis == "x"
    assert event.text.startswith("mode trimmed is not available: a trim gain of 5000 1/s is not ")


def test_safe_gain_is_not_worth_an_event() -> None:
    """The shipped stage can use every mode."""
    stage = RigStage()
    stage.until("SAFE")

    assert not any(each.kind == "trim" for each in stage.events)


@pytest.mark.parametrize("armed", [True, False])
def test_unsafe_gain_is_refused_at_the_switch(armed: bool) -> None:
    """The answer has the reason and the gain that is allowed; the mode stays."""
    stage = RigStage(with_trim(GREEDY, 200.0))
    stage.until("SAFE")
    if armed:
        stage.do(rq.Arm(), rq.SelectMode(mode=Mode.ADAPTIVE))
    before = stage.x.mode

    answer = stage.ask(rq.SelectMode(mode=Mode.TRIMMED))

    assert not answer.accepted
    assert answer.why.startswith("axis x: a trim gain of 5000 1/s is not safe: ")
    assert "use at most " in answer.why
    assert stage.x.mode is before
    assert stage.ask(rq.SelectMode(mode=Mode.ADAPTIVE)).accepted


def test_closed_needs_a_known_first_mode() -> None:
    """The refusal says how to measure it, and is not worth an event before."""
    known, unknown = RigStage(), RigStage(with_axis(shipped_config(), first_mode=None))
    for stage in (known, unknown):
        stage.until("SAFE")
    answer = unknown.ask(rq.SelectMode(mode=Mode.CLOSED))

    assert known.ask(rq.SelectMode(mode=Mode.CLOSED)).accepted
    assert not answer.accepted
    assert "piezod response" in answer.why
    assert not any(each.kind == "trim" for each in unknown.events)


def test_model_with_a_longer_delay_is_judged_when_it_is_adopted() -> None:
    """A gain that was safe is refused with the new delay: the model, if the mode is in use."""
    gain = {"gain_per_s": 100.0}
    file = shipped_config().axes["x"].model
    assert file is not None
    slower = rq.AdoptModel(model=load_model(file).model_copy(update={"delay_s": 0.01}))
    trimmed, other = (RigStage(with_trim(gain, 1000.0, m)) for m in (Mode.TRIMMED, Mode.ADAPTIVE))
    for stage in (trimmed, other):
        stage.until("SAFE")

    assert other.ask(rq.SelectMode(mode=Mode.TRIMMED)).accepted
    assert "a trim gain of 100 1/s is not safe" in trimmed.ask(slower).why
    assert other.ask(slower).accepted
    assert not other.ask(rq.SelectMode(mode=Mode.TRIMMED)).accepted


@pytest.mark.parametrize(("trim", "accepted"), [({"gain_per_s": 50.0}, False), ({}, True)])
def test_mode_of_an_adopted_model_counts_if_the_axis_has_none(
    trim: dict[str, Any], accepted: bool
) -> None:
    """A given gain is refused for it, one that is not given becomes smaller; moves are longer."""
    config = with_axis(with_trim(trim, 1000.0, Mode.TRIMMED), first_mode=None)
    file = config.axes["x"].model
    assert file is not None
    sharp = FoundModeConfig(frequency_hz=100.0, damping=0.005)
    found = load_model(file).model_copy(update={"first_mode": sharp})
    stage = RigStage(config)
    stage.until("SAFE")
    before_s = stage.stage.axes[0].motion_limits.shortest_s

    answer = stage.ask(rq.AdoptModel(model=found))

    assert answer.accepted is accepted
    if accepted:
        shortest_s = stage.stage.axes[0].motion_limits.shortest_s
        assert shortest_s > before_s
        assert shortest_s == pytest.approx(3.0 / 100.0)
    else:
        assert "first mode 100 Hz with damping 0.005" in answer.why
