"""The response with a held drive, against the exact discrete-time system."""

import numpy as np
import pytest
from scipy.linalg import expm

from piezod.dynamics.hold import held
from tests.dynamics.made_up import model_of


@pytest.mark.parametrize("rate_hz", [1700.0, 4000.0, 20_000.0])
def test_held_response_is_that_of_the_exact_system(rate_hz: float) -> None:
    """Folded images give the zero-order-hold equivalent of a mode, up to 0.45 of the rate."""
    mode_hz, damping = 600.0, 0.03
    w = 2.0 * np.pi * mode_hz
    motion, drive = np.array([[0.0, 1.0], [-(w**2), -2.0 * damping * w]]), np.array([0.0, w**2])
    step = expm(motion / rate_hz)
    reached = np.linalg.solve(motion, (step - np.eye(2)) @ drive)
    f = np.linspace(1.0, 0.45 * rate_hz, 300)
    z = np.exp(2j * np.pi * f / rate_hz)
    expected = np.array([np.linalg.solve(each * np.eye(2) - step, reached)[0] for each in z])

    found = held(model_of(0.0, (mode_hz, damping, 1.0)), f, rate_hz)

    # The delay of the hold is left out.
    found = found * np.exp(-1j * np.pi * f / rate_hz)
    assert np.max(np.abs(found - expected) / np.abs(expected).max()) < 2e-3


def test_a_delay_alone_has_no_images() -> None:
    """A stage that follows at once keeps its magnitude."""
    f = np.array([10.0, 80.0])

    assert np.abs(held(model_of(1e-3), f, 200.0)) == pytest.approx([1.0, 1.0])
