"""Errors of all modes on all stages: what stands in the table and in the figure."""

from collections.abc import Iterable, Mapping
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


def worst_of_cases(recordings: Iterable[Recording]) -> ErrorsOfModes:
    """Return the largest errors of any case."""
    worst: dict[str, dict[str, float]] = {}
    for recording in recordings:
        of_mode = worst.setdefault(recording.mode, dict.fromkeys(METRICS, 0.0))
        for name in METRICS:
            of_mode[name] = max(of_mode[name], recording.metrics[name])
    return worst


def variants_table(errors: Errors) -> str:
    """Return the true errors of all stages as a table, one row for each stage."""
    rows = [
        [stage, *(_true_errors(modes[mode]) for mode in SHOWN_MODES)]
        for stage, modes in errors.items()
    ]
    return _table(["stage"], SHOWN_MODES, rows)


def _true_errors(values: Mapping[str, float]) -> str:
    return f"{values['true_tracking_max_pct']:.2f} / {values['true_nonlinearity_pct']:.2f}"


def short_table(modes: ErrorsOfModes) -> str:
    """Return the errors of one stage that tell most as a table, one row for each mode."""
    rows = [
        [mode, *(f"{values[name]:.2f}" for name in SHORT_COLUMNS)] for mode, values in modes.items()
    ]
    return _table(["mode"], SHORT_COLUMNS.values(), rows)


def true_errors_by_case(recordings: Iterable[Recording]) -> ErrorsByCase:
    """Return worst and rms true error of each case and mode, as texts."""
    errors: dict[str, dict[str, str]] = {}
    for each in recordings:
        worst, rms = (each.metrics[f"true_tracking_{name}_pct"] for name in ("max", "rms"))
        errors.setdefault(each.case, {})[each.mode] = f"{worst:.2f} / {rms:.2f}"
    return errors


def fast_table(without: ErrorsByCase, known: ErrorsByCase) -> str:
    """Return the errors without and with a response as a table, one row for each case."""
    rows = [[case, *without[case].values(), *modes.values()] for case, modes in known.items()]
    modes = list(next(iter(known.values())))
    return _table(["sine"], [*modes, *(f"{mode}, response" for mode in modes)], rows)


def _table(texts: list[str], numbers: Iterable[str], rows: Iterable[list[str]]) -> str:
    """Return Markdown: columns of texts at the left, of numbers at the right."""
    heads = [*texts, *numbers]
    rule = ["---"] * len(texts) + ["--:"] * (len(heads) - len(texts))
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (heads, rule, *rows))
