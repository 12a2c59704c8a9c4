import pytest

from piezod.records.labels import (
    metric_group,
    metric_heading,
    metric_label,
    metric_number,
    metric_text,
    metric_unit,
)


@pytest.mark.parametrize(
    ("name", "label", "unit"),
    [
        ("tracking_max_pct", "worst tracking error", "%"),
        ("true_tracking_max_pct", "worst true tracking error", "%"),
        ("noise_rms_pct", "rms sensor noise", "%"),
        ("voltage_error_rms_pct", "rms voltage error", "%"),
        ("loop_width_um", "loop width", "µm"),
        ("settling_time_s", "settling time", "s"),
        ("drive_max_v", "drive max", "V"),
        ("n_merged", "n merged", ""),
        ("depth", "depth", ""),
    ],
)
def test_names_become_words_and_units(name: str, label: str, unit: str) -> None:
    """Known metrics have their own label, others are spelt out; the unit is the suffix."""
    assert metric_label(name) == label
    assert metric_unit(name) == unit


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("nonlinearity_pct", 1.5, "1.50"),
        ("nonlinearity_pct", float("nan"), "–"),
        ("loop_width_um", 0.012345, "0.0123"),
        ("n_merged", 12.0, "12"),
    ],
)
def test_numbers_are_shown_by_unit(name: str, value: float, text: str) -> None:
    """Percentages have two decimals, everything else three digits."""
    assert metric_number(name, value) == text


def test_metric_in_words() -> None:
    """A metric as text ends with its unit, and has no trailing blank if it has no unit."""
    assert metric_text("nonlinearity_pct", 1.519) == "nonlinearity 1.52 %"
    assert metric_text("n_merged", 3.0) == "n merged 3"


def test_metric_without_a_value_is_a_dash_without_a_unit() -> None:
    """NaN does not appear as a percentage."""
    assert metric_text("nonlinearity_pct", float("nan")) == "nonlinearity –"


@pytest.mark.parametrize(
    ("name", "group", "heading"),
    [
        ("tracking_max_pct", "measured", "worst error"),
        ("true_tracking_max_pct", "true", "worst error"),
        ("true_tracking_rms_pct", "true", "rms error"),
        ("nonlinearity_pct", "measured", "nonlinearity"),
        ("true_nonlinearity_pct", "true", "nonlinearity"),
        ("noise_rms_pct", "noise", "rms"),
        ("loop_width_um", "measured", "loop width"),
    ],
)
def test_metrics_are_short_below_the_heading_of_their_group(
    name: str, group: str, heading: str
) -> None:
    """A true error and its measured counterpart differ in the group only."""
    assert metric_group(name) == group
    assert metric_heading(name) == heading


def test_a_time_without_an_end_is_never() -> None:
    """A step that does not settle has no number; an infinite error is no time."""
    assert metric_text("settling_max_s", 0.0123) == "longest settling time 0.0123 s"
    assert metric_text("settling_max_s", float("inf")) == "longest settling time never"
    assert metric_text("tracking_max_pct", float("inf")) == "worst tracking error inf %"
