"""What is said before a result is believed."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.experiment.fit import fit_model
from piezod.experiment.method import Method
from piezod.experiment.run import run_experiment
from piezod.experiment.warnings import fit_warnings, inverse_warnings, run_warnings
from piezod.records.recording import Recording
from tests.experiment.conftest import Load
from tests.experiment.made_up import ORDER, record_of, sine


def recording(mode: str = "adaptive", invalid: int = 0) -> Recording:
    """A run of which the first samples are invalid."""
    ramp = np.arange(200.0)
    measured = np.where(ramp < invalid, np.nan, ramp)
    return Recording("x", "slow", mode, "", ramp, ramp, measured, ramp, ramp, ramp)


@pytest.mark.parametrize("smallest_slope", [0.0, -0.25])
def test_an_inverse_that_is_not_monotone_is_warned_of(smallest_slope: float) -> None:
    """The warning tells the slope and the remedy."""
    (warning,) = inverse_warnings(smallest_slope)

    assert f"not monotone: its smallest slope is {smallest_slope:.2g}" in warning
    assert "record loops of more sizes" in warning


def test_nothing_is_said_without_a_reason() -> None:
    """A good fit and a good run are left without comment."""
    record = record_of()
    fit = fit_model(record, method=Method.LEAST_SQUARES, order=ORDER)

    assert list(fit_warnings(fit, record.period_s)) == []
    assert list(run_warnings(recording(), 0.3, 0)) == []


def test_invalid_samples_are_counted() -> None:
    """The warning says how many, in which run, and what to see to."""
    (warning,) = run_warnings(recording(invalid=5), 0.3, 0)

    assert warning.startswith("slow, adaptive, axis x: 5 of 200 samples, 2.5 %, were invalid")
    assert "See that the sensor" in warning


def test_parameters_that_went_astray_are_said_of_adaptive_runs_only() -> None:
    """Elsewhere the parameters are those of the model, of which it is said once."""
    (warning,) = run_warnings(recording("adaptive"), -0.1, 0)

    assert "the parameters at its end make an inverse that is not monotone" in warning
    assert "slope is -0.1" in warning
    assert "Lower lms_gain" in warning
    assert list(run_warnings(recording("feedforward"), -0.1, 0)) == []


def test_loops_that_were_forgotten_are_said() -> None:
    """The warning says how many pairs of extrema were given up."""
    (warning,) = run_warnings(recording(), 0.3, 7)

    assert "gave up 7 pairs of extrema" in warning


def test_an_experiment_tells_model_and_runs(load: Load, short: str) -> None:
    """Warnings of the axes come first, each with its name, then those of the runs."""
    wild = "    compensator: {operators: 100, lms_gain: 0.02, deadband_pct: 0, delay_s: 0}\n"
    text = short.replace("identification:", wild + "identification:")
    result = run_experiment(load(text), text, "", lambda _label, _share: None)

    first, *others = result.warnings
    assert first.startswith("Axis x: The inverse is not monotone: its smallest slope is -")
    assert [each.split(":")[0] for each in others] == ["slow, adaptive, axis x"]


def test_one_frequency_is_said_with_its_remedy() -> None:
    """Of a delay that was given nothing is said."""
    record = record_of(path=sine)
    estimated = fit_model(record, method=Method.LEAST_SQUARES, order=ORDER)

    (warning,) = fit_warnings(estimated, record.period_s)

    assert warning.startswith("The drive has one frequency.")
    assert "Record several frequencies" in warning
    assert list(fit_warnings(replace(estimated, delay=None), record.period_s)) == []
