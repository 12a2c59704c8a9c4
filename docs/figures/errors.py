"""Errors of all modes on all stages: what stands in the table and in the figure."""

from collections.abc import Iterable, Mapping
from typing import Final

from piezod.experiment.error_rows import errors_pct
from piezod.hysteresis import tracking_rms
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording import Recording

COLUMNS: Final = {
    "tracking_max_pct": "worst",
    "tracking_rms_pct": "rms",
    "nonlinearity_pct": "nonlinearity",
    "true_tracking_max_pct": "**worst**",
    "true_tracking_rms_pct": "**rms**",
    "true_nonlinearity_pct": "**nonlinearity**",
    "noise_rms_pct": "noise",
}
"""Metric → head of its column."""
_COMPUTED_HERE: Final = "true_tracking_rms_pct"

Errors = Mapping[str, Mapping[str, Mapping[str, float]]]
"""Stage → mode → metric → error in % of the range."""


def worst_of_cases(recordings: Iterable[Recording]) -> dict[str, dict[str, float]]:
    """Return mode → metric → the largest error of any case."""
    worst: dict[str, dict[str, float]] = {}
    for recording in recordings:
        of_mode = worst.setdefault(recording.mode, dict.fromkeys(COLUMNS, 0.0))
        for name, value in _errors(recording).items():
            of_mode[name] = max(of_mode[name], value)
    return worst


def _errors(recording: Recording) -> dict[str, float]:
    counted = slice(recording.first_metric_index, None)
    command_um, true_um = recording.command_um[counted], recording.true_um[counted]
    names = tuple(name for name in COLUMNS if name != _COMPUTED_HERE)
    errors = errors_pct(names, command_um, recording.position_um[counted], true_um)
    return {**errors, _COMPUTED_HERE: _true_rms_pct(command_um, true_um)}


def _true_rms_pct(command_um: FloatArray, true_um: FloatArray) -> float:
    return 100.0 * tracking_rms(command_um, true_um)


def markdown_table(errors: Errors) -> str:
    """Return the errors as a table, one row for each stage and mode."""
    lines = [
        "| stage | mode | " + " | ".join(COLUMNS.values()) + " |",
        "|---|---|" + "--:|" * len(COLUMNS),
    ]
    for stage, modes in errors.items():
        for i, (mode, values) in enumerate(modes.items()):
            numbers = " | ".join(f"{values[name]:.2f}" for name in COLUMNS)
            lines.append(f"| {'' if i else stage} | {mode} | {numbers} |")
    return "\n".join(lines) + "\n"
