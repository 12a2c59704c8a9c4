"""Synthetic records: loops similar to those of a piezo, without a model."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from piezod.records.experiment_result import ExperimentResult, Identification, Recording
from piezod.records.reference import Reference

MODES = ("uncompensated", "feedforward", "adaptive")
LOOP_WIDTH = {"uncompensated": 0.12, "feedforward": 0.015, "adaptive": 0.005}


def _recording(axis: str, case: str, mode: str, n_samples: int = 400) -> Recording:
    t_s = np.arange(n_samples) / 100.0
    phase = 2 * np.pi * 0.5 * t_s
    command_um = 7.5 * (1 - np.cos(phase)) / 2
    uncompensated_v = 10 * command_um
    lag_um = 7.5 * LOOP_WIDTH[mode] * np.sin(phase) / 2
    n_snapshots = {"uncompensated": 0, "feedforward": 1, "adaptive": 40}[mode]
    steps = np.arange(n_snapshots)[:, np.newaxis]
    return Recording(
        axis=axis,
        case=case,
        mode=mode,
        title=f"{case}, made up",
        t_s=t_s,
        drive_v=uncompensated_v + (0 if mode == "uncompensated" else 1) * np.sin(phase),
        position_um=command_um - lag_um,
        command_um=command_um,
        uncompensated_v=uncompensated_v,
        true_um=np.full(n_samples, np.nan),
        weights=np.linspace(-0.3, 0.5, 38) * (1 - np.exp(-(steps + 1) / 9)),
        weights_t_s=np.arange(n_snapshots) / 10.0,
        metrics={
            "tracking_max_pct": 55 * LOOP_WIDTH[mode],
            "tracking_rms_pct": 33 * LOOP_WIDTH[mode],
            "nonlinearity_pct": 50 * LOOP_WIDTH[mode],
        },
        first_metric_index=min(200, n_samples - 1),
    )


@pytest.fixture(scope="session")
def make_recording() -> Callable[..., Recording]:
    """Return a function (axis, case, mode, n_samples=400) that makes a synthetic recording."""
    return _recording


@pytest.fixture(scope="session")
def recording() -> Recording:
    """Return a synthetic adaptive recording of 400 samples."""
    return _recording("x", "case 1", "adaptive")


@pytest.fixture(scope="session")
def identification() -> Identification:
    """Return a synthetic identification of 400 samples."""
    shape = _recording("x", "record", "uncompensated")
    return Identification(
        axis="x",
        title="decaying triangle",
        method="least-squares",
        t_s=shape.t_s,
        drive_v=shape.drive_v,
        position_um=shape.position_um,
        predicted_v=shape.drive_v + 0.3 * np.sin(40 * shape.t_s),
        fit_errors={"voltage_error_max_pct": 1.23, "voltage_error_rms_pct": 0.31},
        parameters={"thresholds": np.arange(1, 20) / 20, "right_weights": np.full(19, 0.01)},
    )


@pytest.fixture(scope="session")
def result(identification: Identification) -> ExperimentResult:
    """Return a synthetic experiment of two cases in three modes on one axis."""
    return ExperimentResult(
        title="Made-up experiment <with> & signs",
        recordings=tuple(_recording("x", case, mode) for case in ("case 1", "b") for mode in MODES),
        identifications=(identification,),
        configuration="# µm\nrate_hz: 100\ntitle: <b>&amp;</b>\n",
        versions={"piezod": "0.1.0", "numpy": "2.4"},
        seed=7,
        rate_hz=100.0,
    )


@pytest.fixture(scope="session")
def two_axes(result: ExperimentResult) -> ExperimentResult:
    """Return the synthetic experiment with a second axis."""
    others = tuple(replace(each, axis="y") for each in result.recordings)
    return replace(result, recordings=result.recordings + others)


def _simulated(recording: Recording) -> Recording:
    """Return a recording of a simulated stage: a quarter of its error is noise."""
    true_um = recording.command_um - 0.75 * recording.error_um
    noise_um = 0.02 * np.sin(97.0 * np.arange(true_um.size))
    measured = recording.metrics
    metrics = {
        **measured,
        "true_tracking_max_pct": 0.75 * measured["tracking_max_pct"],
        "true_nonlinearity_pct": 0.75 * measured["nonlinearity_pct"],
        "noise_rms_pct": 0.06,
    }
    position_um = recording.position_um + noise_um
    return replace(recording, true_um=true_um, position_um=position_um, metrics=metrics)


@pytest.fixture(scope="session")
def simulated(result: ExperimentResult) -> ExperimentResult:
    """Return the synthetic experiment on a simulated stage with known true displacement."""
    return replace(result, recordings=tuple(map(_simulated, result.recordings)))


@pytest.fixture(scope="session")
def true_reference(reference: Reference) -> Reference:
    """Return the same reference for the true errors: none of them is missed."""
    return replace(reference, metrics=("true_tracking_max_pct", "true_nonlinearity_pct"))


@pytest.fixture(scope="session")
def reference() -> Reference:
    """Return a reference that case 1 feedforward misses and case 1 adaptive does not."""
    values = {("case 1", "feedforward"): 0.7, ("case 1", "adaptive"): 0.4}
    return Reference("paper", values, ("tracking_max_pct", "nonlinearity_pct"))
