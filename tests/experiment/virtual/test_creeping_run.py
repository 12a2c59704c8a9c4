"""Tests of experiments on a stage that creeps, from identification to the last hold."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from piezod.config.experiment import load_experiment
from piezod.devices import registry
from piezod.experiment.virtual.run import run_experiment
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import ExperimentResult, Recording

HOLDS = """\
rate_hz: 500
seed: 3
devices:
  rig: {driver: simulated, options: {variant: stack}}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
    compensator: {thresholds: graded, creep: true, identifier: rls, sensor_delay_s: 0.00063}
    trim: {base: adaptive}
identification:
  method: least-squares
  settle_s: 2
  run_in_s: 2
  duration_s: 14
  drive_v:
    kind: sequence
    parts:
      - {duration_s: 4, waveform: {kind: sine, low: 0, high: 140, frequency_hz: 0.5}}
      - duration_s: 8
        waveform:
          kind: sine
          low: 0
          high: 140
          frequency_hz: 1
          envelope: {kind: decaying, time_constant_s: 4}
      - {duration_s: 2, waveform: {kind: sine, low: 0, high: 100, frequency_hz: 5}}
modes: [feedforward, adaptive]
metrics: [true_tracking_max_pct]
settle_s: 2
cases:
  - name: hold
    period_s: 1
    duration_s: 7
    command_um:
      kind: sequence
      parts:
        - {duration_s: 1, waveform: {kind: triangle, low: 0, high: 20, frequency_hz: 0.5}}
        - {duration_s: 6, waveform: {kind: setpoint, level: 20}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for experiments."""
    return tmp_path_factory.mktemp("experiments")


@cache
def run(folder: Path, text: str = HOLDS) -> ExperimentResult:
    """Run an experiment from text."""
    path = folder / "holds.yaml"
    path.write_text(text, encoding="utf-8")
    config = load_experiment(path, registry)
    return run_experiment(config, text, "a test", lambda _label, _share: None)


def recording(result: ExperimentResult, mode: str) -> Recording:
    """Return the recording of a mode."""
    return next(r for r in result.recordings if r.mode == mode)


def held_um(result: ExperimentResult, mode: str) -> FloatArray:
    """Return the true displacement from 0.1 s after the motion on, in µm."""
    return recording(result, mode).true_um[550:]


def test_creep_is_identified(folder: Path) -> None:
    """Its size is that of piezo ceramics, and the account of the model contains it."""
    (account,) = run(folder).identifications

    assert account.parameters["creep_weights"].shape == (8,)
    assert 0.003 < account.parameters["creep_weights"][0] < 0.01
    assert account.fit_errors["voltage_error_rms_pct"] < 0.3


def test_holds_creep_less_with_a_creep_model(folder: Path) -> None:
    """With creep in the model the stage creeps by a fraction of its own creep."""
    with_creep = np.ptp(held_um(run(folder), "feedforward"))
    text = HOLDS.replace("creep: true", "creep: false").replace(", adaptive]", "]")
    without = np.ptp(held_um(run(folder, text), "feedforward"))

    assert without > 0.15
    assert with_creep < without / 3
    assert np.ptp(recording(run(folder), "feedforward").drive_v[550:]) > 0.5


@pytest.mark.stress
def test_trim_removes_the_remaining_creep(folder: Path) -> None:
    """In mode trimmed a hold ends at the command, up to noise and sensor."""
    text = HOLDS.replace(", adaptive]", ", trimmed]")
    feedforward_um, trimmed_um = (
        np.abs(held_um(run(folder, text), mode)[-500:] - 20.0)
        for mode in ("feedforward", "trimmed")
    )

    assert trimmed_um.mean() < min(feedforward_um.mean(), 0.03)
    assert trimmed_um.max() < 0.06


def test_nothing_is_learned_in_a_hold(folder: Path) -> None:
    """The weights in use stay when the stage rests."""
    adaptive = recording(run(folder), "adaptive")
    late = adaptive.weights[adaptive.weights_t_s > 3.0]

    assert np.ptp(adaptive.weights, axis=0).max() > 1e-4
    assert np.ptp(late, axis=0).max() < 1e-9
