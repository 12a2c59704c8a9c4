"""The errors that an experiment file gives to compare with."""

from piezod.experiment.reference import reference_of
from piezod.records.reference import Reference
from tests.experiment.conftest import Load


def test_errors_to_compare_with_come_from_the_file(load: Load, short: str) -> None:
    """They are given case by case and mode by mode, and bear the name of whose they are."""
    text = f"{short}    reference_pct: {{adaptive: 1.5}}\nreference: paper\n"

    assert reference_of(load(text)) == Reference(
        label="paper",
        values={("slow", "adaptive"): 1.5},
        metrics=("tracking_max_pct", "nonlinearity_pct"),
    )


def test_true_errors_are_compared_where_they_are_asked_for(load: Load, short: str) -> None:
    """Then the measured ones, which hold those of the sensor as well, are not."""
    metrics = "metrics: [tracking_max_pct, nonlinearity_pct, true_nonlinearity_pct]\n"
    text = f"{short}    reference_pct: {{adaptive: 0.4}}\n{metrics}"
    reference = reference_of(load(text))

    assert reference is not None
    assert reference.metrics == ("true_tracking_max_pct", "true_nonlinearity_pct")


def test_file_without_errors_to_compare_with(load: Load, short: str) -> None:
    """Nothing is compared where nothing is given."""
    assert reference_of(load(short)) is None
