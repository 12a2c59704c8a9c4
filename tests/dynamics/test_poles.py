"""Tests of the first values of resonances."""

import numpy as np

from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.poles import combinations_of_modes, possible_modes


def test_mode_beyond_the_rate_gives_positive_values() -> None:
    """Its image below the rate would have a negative frequency."""
    rate_hz = 1000.0
    frequency_hz = np.linspace(10.0, 0.45 * rate_hz, 60)
    response = ResponseModel(0.0, (Resonance(1.2 * rate_hz, 0.05),)).at(frequency_hz)
    found = list(combinations_of_modes(possible_modes(frequency_hz, response), 1, rate_hz))

    assert any(modes[0, 0] > rate_hz for modes in found)
    assert all((modes > 0.0).all() for modes in found)
