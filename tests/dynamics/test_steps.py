"""Answers to steps: predicted, and averaged over those of a record."""

import numpy as np
import pytest

from piezod.dynamics.measured import FloatArray
from piezod.dynamics.steps import measured_steps, predicted_step
from tests.dynamics.made_up import model_of

RATE_HZ = 10_000.0
MODEL = model_of(3e-4, (450.0, 0.7, 1.3), (800.0, 0.03, -0.3))


def test_prediction_has_delay_overshoot_and_end() -> None:
    """Nothing moves before the delay; a mode overshoots by exp(-πζ/√(1-ζ²)); the end is one."""
    model = model_of(3e-4, (800.0, 0.03, 1.0))
    t_s = np.linspace(0.0, 0.2, 200_001)

    answer = predicted_step(model, t_s)

    assert np.all(answer[t_s < 3e-4] == 0.0)
    assert answer.max() == pytest.approx(1.0 + np.exp(-np.pi * 0.03 / np.sqrt(1 - 0.03**2)))
    assert answer[-1] == pytest.approx(1.0, abs=1e-9)


def test_a_delay_alone_is_a_step() -> None:
    """Without a resonance the answer jumps after the delay."""
    assert predicted_step(model_of(2e-4), np.array([0.0, 1e-4, 2e-4, 1.0])).tolist() == [0, 0, 1, 1]


def test_steps_of_a_record_are_averaged() -> None:
    """Steps up and down give the answer, also with noise and with a falling stage."""
    rng = np.random.default_rng(1)
    levels = np.repeat([70.0, 73.0, 70.0, 73.0, 70.0], 400)
    position = np.zeros(levels.size)
    for place in np.flatnonzero(np.diff(levels)):
        since_s = np.arange(1, levels.size - place) / RATE_HZ
        size = levels[place + 1] - levels[place]
        position[place + 1 :] -= 0.1 * size * predicted_step(MODEL, since_s)

    found = measured_steps(levels, position + 0.001 * rng.standard_normal(2000), RATE_HZ, 0.03)

    assert found is not None
    assert (found.steps, found.t_s.size) == (4, 300)
    assert found.answer == pytest.approx(predicted_step(MODEL, found.t_s), abs=0.01)


@pytest.mark.parametrize("drive", [np.full(500, 3.0), np.sin(np.arange(500) / 9.0)])
def test_record_without_a_step(drive: FloatArray) -> None:
    """A constant drive, and one that always moves, have no step."""
    assert measured_steps(drive, drive, RATE_HZ, 0.1) is None
