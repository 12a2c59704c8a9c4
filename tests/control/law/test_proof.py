"""Tests of the proof of a learned model: it must not be worse than the first one."""

from math import nan

import numpy as np
import pytest

from piezod.control.law.learned_models import ModelProof
from piezod.hysteresis import LearnedModel

WINDOW = 10


def model(weight: float) -> LearnedModel:
    """Return a model of two weights."""
    return LearnedModel(np.full(2, weight), 0.1 * weight, 0.01 * weight)


def proof() -> ModelProof:
    """Return the proof of models that learning changes from the one with the weight 1."""
    return ModelProof(model(1.0), WINDOW, lag_cycles=3)


def weight_after(
    subject: ModelProof, error: float, first_error: float, weight: float = 2.0
) -> float:
    """Run a window with constant errors; return the weight of the proven model."""
    for _ in range(WINDOW):
        subject.add(0.5, error, first_error, model(weight))
    assert subject.proven.offset == pytest.approx(0.1 * subject.proven.weights[0])
    return float(subject.proven.weights[0])


@pytest.mark.parametrize(
    ("error", "first_error", "is_worse"),
    [
        (0.0, 0.0, False),
        (0.009, 0.0, False),  # below the floor
        (0.05, 0.05, False),
        (0.05, 0.2, False),  # better than the first model
        (0.05, 0.03, True),
        (-0.05, 0.0, True),
        (nan, 0.0, True),
    ],
)
def test_model_in_use_is_proven_unless_it_is_worse(
    error: float, first_error: float, is_worse: bool
) -> None:
    """It is worse if its error is beyond one per cent, and √2 times that of the first model."""
    subject = proof()

    assert weight_after(subject, error, first_error) == (1.0 if is_worse else 2.0)
    assert (subject.take_verdict() is not None) == is_worse
    assert subject.take_verdict() is None


def test_model_of_the_start_of_a_window_is_proven() -> None:
    """A change during the window is proved in the next one only."""
    subject = proof()
    for k in range(WINDOW):
        subject.add(0.5, 0.0, 0.0, model(2.0 + k))

    assert subject.proven.weights.tolist() == [2.0, 2.0]


def test_worse_model_takes_back_proven_ones() -> None:
    """The first model is the only one that did not come from this learning."""
    subject = proof()

    assert weight_after(subject, 0.0, 0.0, 2.0) == 2.0
    assert weight_after(subject, 0.1, 0.0, 3.0) == 1.0


def test_error_that_a_delay_explains_does_not_count() -> None:
    """A moving stage that is three cycles late has no worse model."""
    subject = proof()
    weight_after(subject, 0.0, 0.0)
    slow = [subject.add(0.5 + 0.01 * k, min(0.01 * k, 0.03), 0.0, model(2.0)) for k in range(100)]

    assert not any(slow)


def test_another_first_model_is_proven_at_once() -> None:
    """This is the first model of a stage that is identified while it runs."""
    subject = proof()
    subject.restart(model(5.0))

    assert subject.proven.weights.tolist() == subject.first.weights.tolist() == [5.0, 5.0]
