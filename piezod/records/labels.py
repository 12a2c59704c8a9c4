"""Labels for people, from the names in the data."""

import math
from typing import Final

_METRICS: Final = {
    "tracking_max_pct": "worst tracking error",
    "tracking_rms_pct": "rms tracking error",
    "nonlinearity_pct": "nonlinearity",
    "true_tracking_max_pct": "worst true tracking error",
    "true_tracking_rms_pct": "rms true tracking error",
    "true_nonlinearity_pct": "true nonlinearity",
    "noise_rms_pct": "rms sensor noise",
    "settling_max_s": "longest settling time",
    "settling_median_s": "median settling time",
    "voltage_error_max_pct": "worst voltage error",
    "voltage_error_rms_pct": "rms voltage error",
    "position_error_max_pct": "worst position error",
    "position_error_rms_pct": "rms position error",
    "held_out_voltage_error_max_pct": "worst voltage error held out",
    "held_out_voltage_error_rms_pct": "rms voltage error held out",
    "held_out_position_error_max_pct": "worst position error held out",
    "held_out_position_error_rms_pct": "rms position error held out",
}
# Below the heading of a group, "tracking" or "sensor noise" would repeat it.
_WITHIN_GROUP: Final = {
    "tracking_max_pct": "worst error",
    "tracking_rms_pct": "rms error",
    "noise_rms_pct": "rms",
}
NO_VALUE: Final = "–"
_UNITS: Final = {"pct": "%", "um": "µm", "v": "V", "s": "s", "ms": "ms", "hz": "Hz"}


def metric_label(name: str) -> str:
    """Return the label of a metric, without its unit.

    Args:
        name: Name of the metric; an unknown name is spelt out without its unit.
    """
    stem, _, suffix = name.rpartition("_")
    return _METRICS.get(name, (stem if suffix in _UNITS else name).replace("_", " "))


def metric_group(name: str) -> str:
    """Return the group of a metric: "measured" or "true" displacement, or "noise".

    Args:
        name: Name of the metric; an unknown one belongs to the measured displacement.
    """
    first = name.partition("_")[0]
    return first if first in {"true", "noise"} else "measured"


def metric_heading(name: str) -> str:
    """Return the label of a metric below the heading of its group, without its unit."""
    within = name.removeprefix("true_")
    return _WITHIN_GROUP.get(within, metric_label(within))


def metric_unit(name: str) -> str:
    """Return the unit at the end of a metric's name; empty if there is none."""
    return _UNITS.get(name.rpartition("_")[2], "")


def metric_number(name: str, value: float) -> str:
    """Return the value of a metric as displayed everywhere: percent with two decimals.

    A metric without a value, for example the nonlinearity of a constant command, is a dash.
    """
    if math.isnan(value):
        return NO_VALUE
    if _never(name, value):
        return "never"
    return f"{value:.2f}" if metric_unit(name) == "%" else f"{value:.3g}"


def metric_text(name: str, value: float) -> str:
    """Return a metric as text with value and unit, as in "nonlinearity 1.52 %"."""
    unit = "" if math.isnan(value) or _never(name, value) else metric_unit(name)
    return f"{metric_label(name)} {metric_number(name, value)} {unit}".rstrip()


def _never(name: str, value: float) -> bool:
    """Return whether a metric is a time after which nothing happens, such as a settling time."""
    return math.isinf(value) and metric_unit(name) == "s"
