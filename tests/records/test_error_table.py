import math
from dataclasses import replace

import pytest

from piezod.records.error_table import error_table, groups, meaning, verdict
from piezod.records.experiment_result import ExperimentResult
from piezod.records.reference import Reference, is_missed


@pytest.mark.parametrize(
    ("value", "limit", "missed"),
    [
        (1.0, None, False),
        (1.87, 1.87, False),
        (1.8700001, 1.87, True),
        (float("nan"), None, False),
        (float("nan"), 1.87, True),
        (float("inf"), None, True),
    ],
)
def test_missed_is_above_the_limit_or_no_number(
    value: float, limit: float | None, missed: bool
) -> None:
    """An error equal to the limit is allowed; a larger one and NaN are not."""
    assert is_missed(value, limit) == missed


def test_reference_holds_for_its_metrics_only(
    result: ExperimentResult, reference: Reference
) -> None:
    """A limit exists where both the metric and the pair of case and mode are known."""
    by_key = {recording.key: recording for recording in result.recordings}
    known, unknown = by_key["x", "case 1", "adaptive"], by_key["x", "b", "adaptive"]

    assert reference.limit(known, "nonlinearity_pct") == 0.4
    assert reference.limit(known, "tracking_rms_pct") is None
    assert reference.limit(unknown, "nonlinearity_pct") is None


def test_rows_follow_the_recordings(result: ExperimentResult, reference: Reference) -> None:
    """There is a row for each mode of each case, with every recorded metric."""
    table = error_table(result, reference)

    assert list(table) == [("x", "case 1"), ("x", "b")]
    rows = [row for group in table.values() for row in group]
    assert [row.mode for row in rows] == [each.mode for each in result.recordings]
    assert [{cell.metric: cell.value for cell in row.cells} for row in rows] == [
        dict(each.metrics) for each in result.recordings
    ]
    assert [row.reference for row in rows] == [None, 0.7, 0.4, None, None, None]


def test_best_is_the_smallest_of_its_case(result: ExperimentResult) -> None:
    """In each case and metric the mode with the smallest error is the best, and no other."""
    for rows in error_table(result).values():
        assert [[cell.best for cell in row.cells] for row in rows] == [
            [False] * 3,
            [False] * 3,
            [True] * 3,
        ]


def test_a_mode_without_rivals_is_not_called_best(result: ExperimentResult) -> None:
    """A case with only one mode has no best mode."""
    table = error_table(replace(result, recordings=result.recordings[:1]))

    assert not any(cell.best for cell in table["x", "case 1"][0].cells)


def test_a_metric_that_one_recording_lacks_has_no_value_there(result: ExperimentResult) -> None:
    """A recording without one of the metrics gets NaN for it, and the others stay comparable."""
    first, second, *_ = result.recordings
    bare = replace(first, metrics={"nonlinearity_pct": 5.0})
    rows = error_table(replace(result, recordings=(bare, second)))["x", "case 1"]
    cells = {(row.mode, cell.metric): cell for row in rows for cell in row.cells}

    assert math.isnan(cells["uncompensated", "tracking_max_pct"].value)
    assert not cells["uncompensated", "tracking_max_pct"].missed
    assert not cells["uncompensated", "tracking_max_pct"].best
    assert cells["feedforward", "tracking_max_pct"].best


def test_noise_is_no_merit_of_a_mode(simulated: ExperimentResult) -> None:
    """True and measured errors have a best mode; the noise of the sensor has none."""
    (_, _, adaptive), *_ = error_table(simulated).values()

    assert {cell.metric for cell in adaptive.cells if not cell.best} == {"noise_rms_pct"}


def test_true_errors_are_compared_where_the_reference_says_so(
    simulated: ExperimentResult, reference: Reference, true_reference: Reference
) -> None:
    """The sentence states which errors are compared."""
    measured, true = (
        verdict(error_table(simulated, compared), compared)
        for compared in (reference, true_reference)
    )

    assert measured == "2 of 4 measured errors exceed the figure of the paper."
    assert true == "All 4 true errors are at or below the figures of the paper."


def test_metrics_are_grouped_by_what_they_are_errors_of(simulated: ExperimentResult) -> None:
    """The groups are measured, true and noise, each with a sentence about it."""
    found = groups(simulated.metric_names)

    assert [(group, len(names)) for group, names in found] == [
        ("measured", 3),
        ("true", 2),
        ("noise", 1),
    ]
    assert meaning(simulated.metric_names) == (
        "Errors are in % of the displacement's range. Measured: from the sensor. "
        "True: from the simulated stage. "
        "Noise: sensor error without its lag and calibration error."
    )
    assert meaning(["nonlinearity_pct"]).endswith("range. Measured: from the sensor.")
