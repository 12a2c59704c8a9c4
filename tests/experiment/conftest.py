"""Experiments for tests: short, on the simulated rig."""

from collections.abc import Callable
from pathlib import Path

import pytest

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.devices import registry
from tests.experiment.stress_rig import Identified, identified

SHORT = """\
rate_hz: 1000
seed: 3
devices:
  rig: {driver: simulated, options: {variant: stack}}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 20000, rest_v: 0}
identification:
  method: least-squares
  settle_s: 0.5
  duration_s: 4
  drive_v:
    kind: sine
    low: 0
    high: 140
    frequency_hz: 1
    envelope: {kind: decaying, time_constant_s: 4}
settle_s: 0.5
cases:
  - name: slow
    period_s: 1
    duration_s: 3
    command_um: {kind: sine, low: 0, high: 20, frequency_hz: 1}
"""

SLOW_LOOP = SHORT.replace("rate_hz: 1000", "rate_hz: 200")
"""The same at a rate that takes half of the time."""

Load = Callable[[str], ExperimentConfig]


@pytest.fixture
def short() -> str:
    """Return the text of an experiment that takes one second."""
    return SHORT


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Return a function that loads an experiment from text."""

    def from_text(text: str) -> ExperimentConfig:
        path = tmp_path / "experiment.yaml"
        path.write_text(text, encoding="utf-8")
        return load_experiment(path, registry)

    return from_text


@pytest.fixture(scope="session")
def shared_by_workers(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Return a folder that all processes of this test run share."""
    own = tmp_path_factory.getbasetemp()
    return own if worker_id == "master" else own.parent


@pytest.fixture
def beyond_stage(shared_by_workers: Path, request: pytest.FixtureRequest) -> Identified:
    """Return the stage of `beyond.yaml` with a model of stops; `make test` has half the rate."""
    return identified(shared_by_workers, "graded", whole="stress" in request.keywords)


@pytest.fixture(scope="session")
def even_stage(shared_by_workers: Path) -> Identified:
    """Return the same with evenly spaced thresholds, which LMS needs."""
    return identified(shared_by_workers, "even")
