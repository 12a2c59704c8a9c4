"""Commands that go in steps."""

import numpy as np
import pytest

from piezod.experiment.error_rows import errors_pct
from piezod.experiment.steps import held, levels_of, settling_times_s, step_metrics
from piezod.hysteresis.memory import FloatArray

PERIOD_S = 0.001
LEVEL = 500
TIME_CONSTANT_S = 0.02


def staircase() -> FloatArray:
    """Return a command of four levels."""
    return np.repeat([0.0, 5.0, 12.0, 3.0], LEVEL)


def response(command_um: FloatArray) -> FloatArray:
    """Return the position of a stage with a lag of 20 ms, in µm."""
    position_um = np.empty_like(command_um)
    x, share = command_um[0], 1.0 - np.exp(-PERIOD_S / TIME_CONSTANT_S)
    for k, command in enumerate(command_um):
        x += share * (command - x)
        position_um[k] = x
    return position_um


def test_steps_are_told_from_other_commands() -> None:
    """Only a command that stays on levels goes in steps; a slow sine does not."""
    assert levels_of(staircase()) == [
        slice(0, 500),
        slice(500, 1000),
        slice(1000, 1500),
        slice(1500, 2000),
    ]
    assert levels_of(np.sin(np.linspace(0.0, 6.0, 2000))) == []
    assert levels_of(np.full(2000, 3.0)) == []
    assert held(np.sin(np.linspace(0.0, 6.0, 2000))).all()


def test_settling_time_is_that_of_the_lag() -> None:
    """An exponential is within 2 % of its step after 3.9 time constants, whatever the step."""
    times_s = settling_times_s(staircase(), response(staircase()), PERIOD_S)

    assert times_s == pytest.approx([np.log(50.0) * TIME_CONSTANT_S] * 3, abs=2 * PERIOD_S)
    metrics = step_metrics(staircase(), response(staircase()), PERIOD_S)
    assert metrics == {"settling_max_s": max(times_s), "settling_median_s": np.median(times_s)}
    assert step_metrics(np.linspace(0.0, 1.0, 100), np.linspace(0.0, 1.0, 100), PERIOD_S) == {}


def test_stage_that_swings_on_never_settles() -> None:
    """A slow oscillation of 10 % of the step has no settling time."""
    t_s = PERIOD_S * np.arange(4 * LEVEL)
    swinging = response(staircase()) + 1.0 * np.sin(2.0 * np.pi * 10.0 * t_s)

    assert np.isinf(max(settling_times_s(staircase(), swinging, PERIOD_S)))


def test_errors_are_those_on_the_levels() -> None:
    """The edge of a step is no tracking error; a wrong level is."""
    command_um, position_um = staircase(), response(staircase())
    unknown = np.full_like(command_um, np.nan)

    exact = errors_pct(("tracking_max_pct",), command_um, position_um, unknown)
    low = errors_pct(("tracking_max_pct",), command_um, position_um - 0.6, unknown)
    assert exact["tracking_max_pct"] < 0.01
    assert low["tracking_max_pct"] == pytest.approx(5.0, rel=0.01)
