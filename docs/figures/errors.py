"""Errors of all modes on all stages: what stands in the tables and in the figure."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from piezod.config.modes import Mode
from piezod.records.experiment_result import Recording

METRICS: Final = (
    "tracking_max_pct",
    "nonlinearity_pct",
    "true_tracking_max_pct",
    "true_nonlinearity_pct",
    "noise_rms_pct",
)
STOPS: Final = "stops, feedforward"
"""Stands beside the modes: feedforward by a model of stops."""
SHOWN_MODES: Final = (STOPS, Mode.FEEDFORWARD, Mode.ADAPTIVE, Mode.TRIMMED)
SHORT_COLUMNS: Final = {
    "true_tracking_max_pct": "worst error, true",
    "true_nonlinearity_pct": "nonlinearity, true",
    "tracking_max_pct": "worst error, measured",
    "nonlinearity_pct": "nonlinearity, measured",
    "noise_rms_pct": "noise of the sensor, rms",
}
ErrorsOfModes = Mapping[str, Mapping[str, float]]
"""Mode → metric → error in % of the range."""
Errors = Mapping[str, ErrorsOfModes]
"""Stage → its errors."""
ErrorsByCase = Mapping[str, Mapping[str, str]]
"""Case → mode → its errors, as a text."""
Rows = Iterator[list[str]]
"""A table as texts, its headings first."""


def worst_of_cases(recordings: Iterable[Recording]) -> ErrorsOfModes:
    """Return the largest errors of any case."""
    worst: dict[str, dict[str, float]] = {}
    for recording in recordings:
        of_mode = worst.setdefault(recording.mode, dict.fromkeys(METRICS, 0.0))
        for name in METRICS:
            of_mode[name] = max(of_mode[name], recording.metrics[name])
    return worst


def variants_rows(errors: Errors) -> Rows:
    """Return the true errors of all stages: the headings, and one row for each stage."""
    yield ["stage", *SHOWN_MODES]
    for stage, modes in errors.items():
        yield [stage, *(_true_errors(modes[mode]) for mode in SHOWN_MODES)]


def _true_errors(values: Mapping[str, float]) -> str:
    return f"{values['true_tracking_max_pct']:.2f} / {values['true_nonlinearity_pct']:.2f}"


def short_rows(modes: ErrorsOfModes) -> Rows:
    """Return the errors of one stage that tell most: the headings, and one row for each mode."""
    yield ["mode", *SHORT_COLUMNS.values()]
    for mode, values in modes.items():
        yield [mode, *(f"{values[name]:.2f}" for name in SHORT_COLUMNS)]


def true_errors_by_case(recordings: Iterable[Recording]) -> ErrorsByCase:
    """Return worst and rms true error of each case and mode, as texts."""
    errors: dict[str, dict[str, str]] = {}
    for each in recordings:
        worst, rms = (each.metrics[f"true_tracking_{name}_pct"] for name in ("max", "rms"))
        errors.setdefault(each.case, {})[each.mode] = f"{worst:.2f} / {rms:.2f}"
    return errors


def fast_rows(without: ErrorsByCase, known: ErrorsByCase) -> Rows:
    """Return the errors without and with a response: the headings, and one row for each case."""
    modes = list(next(iter(known.values())))
    yield ["sine", *modes, *(f"{mode}, response" for mode in modes)]
    for case, with_response in known.items():
        yield [case, *without[case].values(), *with_response.values()]
