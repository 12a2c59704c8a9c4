"""The fit of a response: modes, delay, gains, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config import response_file
from piezod.dynamics import fit_problem
from piezod.dynamics.fitting import ResponseFit, fit_response
from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.model import ResponseModel
from piezod.errors import DataError
from tests.dynamics.made_up import CREEP, PHASE_RAD, frequencies, model_of, noisy

STANDARD = 4.0
"""Allowed distance, in standard uncertainties."""


def check(fit: ResponseFit, model: ResponseModel) -> None:
    """Compare a fit with the truth, by its own uncertainties."""
    assert len(fit.model.resonances) == len(model.resonances)
    assert abs(fit.model.delay_s - model.delay_s) <= STANDARD * fit.delay_uncertainty_s
    for found, uncertain, true in zip(
        fit.model.resonances, fit.uncertainties, model.resonances, strict=True
    ):
        assert abs(found.frequency_hz - true.frequency_hz) <= STANDARD * uncertain[0]
        assert abs(found.damping - true.damping) <= STANDARD * uncertain[1]
        assert abs(found.share - true.share) <= STANDARD * uncertain[2] + 1e-12


def test_small_loops_do_not_look_like_a_filter() -> None:
    """Fast lines are weaker, and the gain of smaller loops is smaller: that is no delay."""
    model, f = model_of(240e-6, (800.0, 0.03, 1.0)), np.geomspace(2.0, 900.0, 100)
    lines = noisy(model, 0.01, 3, f)
    fit = fit_response(
        [replace(lines, response=lines.response * (1.0 - 0.09 / (1.0 + (150 / f) ** 2)))]
    )

    assert frequencies(fit.model) == pytest.approx([800.0], rel=0.003)
    assert fit.model.delay_s == pytest.approx(240e-6, abs=20e-6)


def test_weak_mode_below_another_is_found() -> None:
    """A mode with little damping may have any share."""
    model = model_of(240e-6, (300.0, 0.02, 0.1), (800.0, 0.03, 0.9))

    check(fit_response([noisy(model, 0.01, 3)]), model)


@settings(max_examples=settings().max_examples // 6)
@given(st.floats(50.0, 2000.0), st.floats(0.005, 0.2), st.floats(0.0, 1e-3), st.integers(0, 2**16))
def test_one_mode_is_found_within_its_uncertainty(
    frequency_hz: float, damping: float, delay_s: float, seed: int
) -> None:
    """Frequency, damping and delay of any mode are found as well as the fit says."""
    model = model_of(delay_s, (frequency_hz, damping, 1.0))

    check(fit_response([noisy(model, 0.01, seed)]), model)


@pytest.mark.parametrize(
    "model",
    [
        model_of(3e-4),
        model_of(3e-4, (450.0, 0.7, 1.3), (800.0, 0.03, -0.3)),
        pytest.param(
            model_of(0.0, (300.0, 0.02, 0.9), (800.0, 0.01, 0.1)), marks=pytest.mark.stress
        ),
        model_of(1e-3, (200.0, 0.01, 0.6), (500.0, 0.01, 0.3), (1500.0, 0.01, 0.1)),
    ],
    ids=["none", "filter and mode", "two", "three"],
)
def test_number_of_resonances_is_found(model: ResponseModel) -> None:
    """The criterion takes as many resonances as there are, from none to three."""
    fit = fit_response([noisy(model, 0.01, 7)])

    check(fit, model)
    assert fit.phase_rad == pytest.approx(PHASE_RAD, abs=0.01)
    assert fit.creep == pytest.approx(CREEP, abs=0.004)
    assert 0.7 < fit.rms < 1.3


def test_gain_is_kept_apart() -> None:
    """Voltages differ in gain and sign, and share the dynamics."""
    model = model_of(3e-4, (800.0, 0.03, 1.0))
    both = [noisy(model, 0.01, 1, gain=-0.1), noisy(model, 0.01, 2, gain=-0.2)]

    fit = fit_response(both)

    check(fit, model)
    for (gain, uncertain), true in zip(fit.gains, (-0.1, -0.2), strict=True):
        assert abs(gain - true) <= STANDARD * uncertain
    f = both[1].frequency_hz
    assert np.allclose(fit.slow_part(1, f) * fit.model.at(f), both[1].response, atol=0.02)


def test_mode_above_the_lines_is_not_claimed() -> None:
    """A mode that the lines do not reach is no result."""
    model = model_of(1e-4, (3000.0, 0.02, 1.0))

    fit = fit_response([noisy(model, 0.003, 3, np.geomspace(1.0, 450.0, 80))])

    assert not [mode for mode in fit.model.resonances if mode.damping < 0.5]


def test_noise_is_refused() -> None:
    """Lines that are not clear of the noise give no model, and the reason in numbers."""
    f = np.geomspace(5.0, 4000.0, 120)
    rng = np.random.default_rng(5)
    noise = np.asarray(rng.standard_normal(120) + 1j * rng.standard_normal(120))

    with pytest.raises(DataError, match=r"no model: 0 of 120 lines are clear of the noise; needed"):
        fit_response([MeasuredResponse(f, noise, np.full(120, 2.0), np.zeros(120))])


def test_narrow_band_is_refused() -> None:
    """Without a span of frequencies a delay cannot be told from a phase."""
    measured = noisy(model_of(3e-4), 0.01, 1, np.linspace(100.0, 200.0, 50))

    with pytest.raises(DataError, match=r"50 of 50 lines .* from 100 to 200 Hz"):
        fit_response([measured])


def test_modes_are_told_from_filters_as_in_the_configuration() -> None:
    """The damping that separates them stands in two rooms that must not know each other."""
    assert fit_problem.RINGS_BELOW == response_file.RINGS_BELOW


def test_frequencies_increase() -> None:
    """Resonances are in the order that a response file requires."""
    model = model_of(0.0, (300.0, 0.02, 0.9), (800.0, 0.01, 0.1))

    found = frequencies(fit_response([noisy(model, 0.01, 9)]).model)

    assert found == sorted(found)
