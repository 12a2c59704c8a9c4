"""Tests of the warnings about models and runs."""

from dataclasses import replace

import numpy as np

from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.warnings import fit_warnings
from piezod.experiment.virtual.run import run_experiment
from piezod.experiment.warnings import run_warnings
from piezod.records.experiment_result import Recording
from tests.experiment.conftest import SLOW_LOOP, Load
from tests.experiment.made_up import ORDER, record_of, sine


def recording(mode: str = "adaptive", invalid: int = 0) -> Recording:
    """Return a run whose first samples are invalid."""
    ramp = np.arange(200.0)
    measured = np.where(ramp < invalid, np.nan, ramp)
    return Recording("x", "slow", mode, "", ramp, ramp, measured, ramp, ramp, ramp)


def test_good_fit_and_run_have_no_warning() -> None:
    """There is no warning without a reason."""
    record = record_of()
    fit = fit_model(record, FitSettings(order=ORDER))

    assert list(fit_warnings(fit, record.period_s)) == []
    assert list(run_warnings(recording(), 0)) == []


def test_invalid_samples_are_counted() -> None:
    """The warning has their number, the run and the remedy."""
    (warning,) = run_warnings(recording(invalid=5), 0)

    assert warning.startswith("slow, adaptive, axis x: 5 of 200 samples, 2.5 %, were invalid")
    assert "Check that the sensor" in warning


def test_removed_extrema_have_a_warning() -> None:
    """The warning has the number of removed pairs."""
    (warning,) = run_warnings(recording(), 7)

    assert "removed 7 pairs of extrema" in warning


def test_experiment_has_the_warnings_of_cases_and_models(load: Load) -> None:
    """The warnings of the cases come first, then those of the axes, both with their names."""
    crowded = "envelope: {kind: decaying, time_constant_s: 4}"
    text = SLOW_LOOP.replace(crowded, "envelope: {kind: constant}")
    text = text.replace("period_s: 1", "period_s: 0.025").replace(
        "high: 20, frequency_hz: 1", "high: 20, frequency_hz: 40"
    )
    result = run_experiment(load(text), text, "", lambda _label, _share: None)

    case, axis = result.warnings
    assert case.startswith("slow, axis x: ")
    assert axis.startswith("Axis x: The drive has one frequency.")


def test_one_frequency_has_a_warning_with_a_remedy() -> None:
    """A given delay has no warning."""
    record = record_of(path=sine)
    estimated = fit_model(record, FitSettings(order=ORDER))

    (warning,) = fit_warnings(estimated, record.period_s)

    assert warning.startswith("The drive has one frequency.")
    assert "Record several frequencies" in warning
    assert list(fit_warnings(replace(estimated, delay=None), record.period_s)) == []
