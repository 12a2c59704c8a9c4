"""The shipped experiments beyond the paper, one per stage variant, agree with each other."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from piezod.config.experiment import load_experiment
from piezod.devices import registry
from tests.experiment.beyond import experiment_of, small_loops

EXPERIMENTS = Path(__file__).parents[2] / "config" / "experiments"
VARIANTS = {
    "beyond-afm.yaml": "afm",
    "beyond-bipolar.yaml": "bipolar",
    "beyond-flexure.yaml": "flexure",
    "beyond-uncalibrated.yaml": "stack-uncalibrated",
}
_OF_THE_STACK = {"title", "variant", "reference", "reference_pct"}


def shape(value: Any) -> Any:
    """Return a document without its numbers, and without the parts of the stack's file alone."""
    if isinstance(value, dict):
        return {key: shape(item) for key, item in value.items() if key not in _OF_THE_STACK}
    if isinstance(value, list):
        return [shape(item) for item in value]
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else value


def document(name: str) -> Any:
    """Return a file as plain dictionaries and lists."""
    return yaml.safe_load((EXPERIMENTS / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_differs_in_numbers_only(name: str) -> None:
    """Keys, waveforms, modes and metrics are those of the stack's file."""
    assert shape(document(name)) == shape(document("beyond.yaml"))


@pytest.mark.parametrize(("name", "variant"), VARIANTS.items())
def test_a_variant_can_be_run_and_promises_nothing(name: str, variant: str) -> None:
    """The file is valid, uses the stage of its name, and has no reference errors."""
    config = load_experiment(EXPERIMENTS / name, registry)

    assert document(name)["devices"]["rig"]["options"] == {"variant": variant}
    assert not any(case.reference_pct for case in config.cases)


def test_the_uncalibrated_sensor_gets_the_same_numbers() -> None:
    """The runs of the two stacks differ in the sensor alone."""
    stack, uncalibrated = document("beyond.yaml"), document("beyond-uncalibrated.yaml")
    for key in ("rate_hz", "seed", "axes", "identification", "settle_s"):
        assert uncalibrated[key] == stack[key]
    for one, other in zip(uncalibrated["cases"], stack["cases"], strict=True):
        assert one["command_um"] == other["command_um"]


def test_small_loops_are_an_experiment() -> None:
    """Loops of 2, 5 and 10 % of the travel, at three heights, for the tables of small loops."""
    config = small_loops(experiment_of("stack"))

    assert [case.name for case in config.cases] == ["0.6 µm", "1.5 µm", "3 µm"]
