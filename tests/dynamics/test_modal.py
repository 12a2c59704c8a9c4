"""Tests of the motion of a mode from cycle to cycle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.dynamics import Resonance
from piezod.dynamics.modal import modal_step

SUB_STEPS = 400


def integrated(mode: Resonance, period_s: float, corners: list[float]) -> list[float]:
    """Return what a mode adds to straight lines between corners, by many small steps."""
    turn = 2.0 * np.pi * mode.frequency_hz * period_s / SUB_STEPS
    position, speed, added = 0.0, 0.0, []
    before = 0.0

    def rates(state: np.ndarray, static: float) -> np.ndarray:
        return turn * np.array([state[1], static - state[0] - 2.0 * mode.damping * state[1]])

    state = np.array([position, speed])
    for corner in corners:
        for k in range(SUB_STEPS):
            low = before + (corner - before) * k / SUB_STEPS
            high = before + (corner - before) * (k + 1) / SUB_STEPS
            first = rates(state, low)
            second = rates(state + first / 2, 0.5 * (low + high))
            third = rates(state + second / 2, 0.5 * (low + high))
            fourth = rates(state + third, high)
            state = state + (first + 2 * second + 2 * third + fourth) / 6
        before = corner
        added.append(float(state[0]) - corner)
    return added


@given(
    turns=st.floats(0.005, 0.9),
    damping=st.floats(0.003, 1.0),
    corners=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=6),
)
def test_steps_are_those_of_the_differential_equation(
    turns: float, damping: float, corners: list[float]
) -> None:
    """At any number of turns in a cycle the step is exact, up to the integration it is held to."""
    step = modal_step(Resonance(1000.0 * turns, damping), 1e-3)
    added, speed, before, found = 0.0, 0.0, 0.0, []
    for corner in corners:
        change, before = corner - before, corner
        added, speed = (
            step.added_added * added + step.added_speed * speed + step.added_step * change,
            step.speed_added * added + step.speed_speed * speed + step.speed_step * change,
        )
        found.append(added)

    assert found == pytest.approx(
        integrated(Resonance(1000.0 * turns, damping), 1e-3, corners), abs=1e-6
    )


def test_mode_adds_nothing_to_a_constant_and_a_constant_lag_to_a_ramp() -> None:
    """On a ramp a mode lags by 2ζ/ω; the rest has decayed."""
    mode, period_s = Resonance(700.0, 0.1), 1e-4
    step = modal_step(mode, period_s)
    added, speed = 0.0, 0.0
    for _ in range(2000):
        added, speed = (
            step.added_added * added + step.added_speed * speed + step.added_step * 0.01,
            step.speed_added * added + step.speed_speed * speed + step.speed_step * 0.01,
        )

    assert added == pytest.approx(-0.01 / period_s * 2.0 * 0.1 / (2.0 * np.pi * 700.0))
