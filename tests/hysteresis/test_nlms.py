"""Normalised LMS: its equation, and the effect of the normalisation."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import ModelError
from piezod.hysteresis import NLMSIdentifier, even_thresholds, new_bank, stop_regressors
from piezod.hysteresis.slopes import LEAST_SLOPE, cells, fill_slopes, least_slope
from tests.hysteresis import oracle
from tests.hysteresis.draw import command, inputs

Array = NDArray[np.float64]
THRESHOLDS = even_thresholds(19)
BANK = new_bank(THRESHOLDS, THRESHOLDS)


def drives_for(positions: Array) -> Array:
    """Return the drives of a known model."""
    return positions + stop_regressors(BANK, positions) @ np.linspace(0.04, 0.0, 38)


@settings(max_examples=30)
@given(positions=inputs(least=2, most=30), gain=st.floats(0.01, 1.0), floor=st.floats(1e-3, 1.0))
def test_a_step_is_that_of_the_normalised_equation(
    positions: Array, gain: float, floor: float
) -> None:
    """Each step is a ← a + μ e φ / (ε + ‖φ‖²), while the weights have an inverse."""
    nlms = NLMSIdentifier(BANK, gain=gain, floor=floor)
    stops = oracle.stops(list(THRESHOLDS), list(THRESHOLDS))
    weights, widths = np.zeros(38), cells(BANK)
    slopes = np.empty_like(widths)

    for x in positions:
        phi, drive = stops(float(x)) - x, 0.98 * x + 0.01
        error = drive - (x + weights @ phi)
        weights = weights + gain * error * phi / (floor + phi @ phi)
        fill_slopes(BANK, weights, slopes)
        assume(least_slope(slopes, widths) > LEAST_SLOPE)  # otherwise they are projected
        assert nlms.step(x, drive) == pytest.approx(error, abs=1e-12)

    np.testing.assert_allclose(nlms.weights, weights, rtol=0, atol=1e-12)


def test_known_drives_are_learned() -> None:
    """After some periods it predicts the drive to two thousandths of the range."""
    positions = command(40.0)
    nlms = NLMSIdentifier(BANK)

    errors = nlms.run(positions, drives_for(positions))

    assert np.max(np.abs(errors[-4000:])) < 2e-3


@pytest.mark.parametrize("order", [5, 19, 60])
def test_largest_gain_is_stable_for_any_number_of_operators(order: int) -> None:
    """At μ = 1.9 a dwell at tiny amplitude and then a full swing leave the weights in bounds."""
    bank = new_bank(even_thresholds(order), even_thresholds(order))
    nlms = NLMSIdentifier(bank, gain=1.9)
    positions = np.concatenate((command(50.0, 0.005), command(4.0)))

    errors = nlms.run(positions, np.sqrt(positions))

    assert np.max(np.abs(errors)) < 1.0
    assert np.max(np.abs(nlms.weights)) < 10.0


@pytest.mark.parametrize("gain", [0.0, 2.0, -0.1, float("nan")])
def test_gain_outside_its_range_is_refused(gain: float) -> None:
    """The bounds themselves are excluded, because they do not converge."""
    with pytest.raises(ModelError, match="above 0 and below 2"):
        NLMSIdentifier(BANK, gain=gain)


@pytest.mark.parametrize("floor", [0.0, -1.0, float("inf"), float("nan")])
def test_floor_outside_its_range_is_refused(floor: float) -> None:
    """Without a floor, a pair that moves no stop would cause a division by zero."""
    with pytest.raises(ModelError, match="finite and above 0"):
        NLMSIdentifier(BANK, floor=floor)


def test_the_part_outside_the_range_counts_with_slope_one() -> None:
    """The operators get the end of the range, but the error includes the part outside."""
    nlms = NLMSIdentifier(BANK)

    errors = [nlms.step(-0.002, 0.0), nlms.step(0.0, 0.0), nlms.step(1.2, 1.0)]

    assert errors == pytest.approx([0.002, 0.0, -0.2], abs=1e-12)
    assert nlms.position == 1.0
