"""Tests of the motion of the first mode for held values."""

import numpy as np
import pytest

from piezod.control.law.first_mode import FirstMode
from piezod.hysteresis.memory import FloatArray

PERIOD_S = 1e-3
MODE = FirstMode(frequency_hz=130.0, damping=0.04)


def exact(values: FloatArray, start_periods: float) -> FloatArray:
    """Return the motion as a sum of step responses, shape (n,).

    Args:
        values: (n,) held values.
        start_periods: Time from a sample to the start of its held value, in sample periods.
    """
    motion = np.full(values.size, values[0])
    samples = np.arange(values.size, dtype=np.float64)
    damped = (1.0 - MODE.damping**2) ** 0.5
    for k, jump in enumerate(np.diff(values), start=1):
        since_s = np.maximum(samples - k - start_periods, 0.0) * PERIOD_S
        angle = 2.0 * np.pi * MODE.frequency_hz * since_s
        ringing = np.cos(damped * angle) + MODE.damping / damped * np.sin(damped * angle)
        motion += jump * (1.0 - np.exp(-MODE.damping * angle) * ringing)
    return motion


@pytest.mark.parametrize("delay_periods", [0.5, 0.0, 0.3, 1.5, 4.83, -0.2])
def test_motion_of_held_values_is_exact(delay_periods: float) -> None:
    """It is that of the differential equation, for a delay of any fraction of a period."""
    values = np.random.default_rng(1).standard_normal(200)
    values[-2:] = values[-3]  # later values are not known to a negative delay

    motion = MODE.shown(values, delay_periods * PERIOD_S, PERIOD_S)

    assert motion == pytest.approx(exact(values, delay_periods - 0.5), abs=1e-9)


def test_columns_move_independently() -> None:
    """Several values move at once as each of them alone."""
    values = np.random.default_rng(2).standard_normal((50, 3))

    motion = MODE.shown(values, 2e-3, PERIOD_S)

    alone = [MODE.shown(column, 2e-3, PERIOD_S) for column in values.T]
    assert motion == pytest.approx(np.stack(alone, axis=1), abs=1e-12)


def test_slow_motion_is_as_late_as_by_interpolation() -> None:
    """A delay means the same with a mode and without one."""
    t_s: FloatArray = np.arange(2000, dtype=np.float64) * PERIOD_S
    values = np.sin(2.0 * np.pi * t_s)

    motion = MODE.shown(values, 3.3 * PERIOD_S, PERIOD_S)

    of_mode_s = 2.0 * MODE.damping / (2.0 * np.pi * MODE.frequency_hz)
    late = np.sin(2.0 * np.pi * (t_s - 3.3 * PERIOD_S - of_mode_s))
    assert motion[1000:] == pytest.approx(late[1000:], abs=2e-4)
