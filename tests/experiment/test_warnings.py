"""What is said before a result is believed."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.experiment.fit.fit import FitSettings, fit_model
from piezod.experiment.fit.warnings import fit_warnings, saturation_warnings
from piezod.experiment.virtual.run import run_experiment
from piezod.experiment.warnings import run_warnings
from piezod.records.recording import Recording
from tests.experiment.conftest import Load
from tests.experiment.made_up import ORDER, POSITION_UM, record_of, sine


def recording(mode: str = "adaptive", invalid: int = 0) -> Recording:
    """A run of which the first samples are invalid."""
    ramp = np.arange(200.0)
    measured = np.where(ramp < invalid, np.nan, ramp)
    return Recording("x", "slow", mode, "", ramp, ramp, measured, ramp, ramp, ramp)


def test_nothing_is_said_without_a_reason() -> None:
    """A good fit and a good run are left without comment."""
    record = record_of()
    fit = fit_model(record, FitSettings(order=ORDER))

    assert list(fit_warnings(fit, record.period_s)) == []
    assert list(run_warnings(recording(), 0)) == []


def test_invalid_samples_are_counted() -> None:
    """The warning says how many, in which run, and what to see to."""
    (warning,) = run_warnings(recording(invalid=5), 0)

    assert warning.startswith("slow, adaptive, axis x: 5 of 200 samples, 2.5 %, were invalid")
    assert "Check that the sensor" in warning


@pytest.mark.parametrize(("low", "high", "end"), [(0.0, 0.7, "highest"), (0.2, 1.0, "lowest")])
def test_a_sensor_that_saturates_is_said(low: float, high: float, end: str) -> None:
    """At either end, with the remedy."""
    record = record_of()
    position_um = np.clip(record.position_um, low * POSITION_UM, high * POSITION_UM)

    (warning,) = saturation_warnings(replace(record, position_um=position_um))

    assert warning.startswith(f"The displacement stands at its {end} value")
    assert "Use a smaller drive" in warning


@pytest.mark.parametrize("digits", [0, 1, 3])
def test_a_sensor_that_counts_in_steps_is_no_reason(digits: int) -> None:
    """At a turning point a coarse sensor shows the same value for some time."""
    record = record_of()

    rounded = replace(record, position_um=np.round(record.position_um, digits))

    assert list(saturation_warnings(rounded)) == []


def test_loops_that_were_forgotten_are_said() -> None:
    """The warning says how many pairs of extrema were given up."""
    (warning,) = run_warnings(recording(), 7)

    assert "removed 7 pairs of extrema" in warning


def test_an_experiment_tells_of_models_and_runs(load: Load, short: str) -> None:
    """Warnings of the axes come first, each with its name, then those of the runs."""
    crowded = "envelope: {kind: decaying, time_constant_s: 4}"
    text = short.replace(crowded, "envelope: {kind: constant}")
    result = run_experiment(load(text), text, "", lambda _label, _share: None)

    first, *others = result.warnings
    assert first.startswith("Axis x: The drive has one frequency.")
    assert all(each.startswith("slow, ") for each in others)


def test_one_frequency_is_said_with_its_remedy() -> None:
    """Of a delay that was given nothing is said."""
    record = record_of(path=sine)
    estimated = fit_model(record, FitSettings(order=ORDER))

    (warning,) = fit_warnings(estimated, record.period_s)

    assert warning.startswith("The drive has one frequency.")
    assert "Record several frequencies" in warning
    assert list(fit_warnings(replace(estimated, delay=None), record.period_s)) == []
