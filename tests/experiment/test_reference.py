"""Tests of the reference errors in an experiment file."""

from piezod.experiment.reference import reference_of
from piezod.records.reference import Reference
from tests.experiment.conftest import Load


def test_reference_errors_come_from_the_file(load: Load, short: str) -> None:
    """They are given by case and mode, with the name of their source."""
    text = f"{short}    reference_pct: {{adaptive: 1.5}}\nreference: paper\n"

    assert reference_of(load(text)) == Reference(
        label="paper",
        values={("slow", "adaptive"): 1.5},
        metrics=("tracking_max_pct", "nonlinearity_pct"),
    )


def test_true_errors_are_compared_if_requested(load: Load, short: str) -> None:
    """Then the measured errors, which contain those of the sensor, are not compared."""
    metrics = "metrics: [tracking_max_pct, nonlinearity_pct, true_nonlinearity_pct]\n"
    text = f"{short}    reference_pct: {{adaptive: 0.4}}\n{metrics}"
    reference = reference_of(load(text))

    assert reference is not None
    assert reference.metrics == ("true_tracking_max_pct", "true_nonlinearity_pct")


def test_file_without_reference_errors(load: Load, short: str) -> None:
    """Then there is no comparison."""
    assert reference_of(load(short)) is None
