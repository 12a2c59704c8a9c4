"""Errors of all modes on all stages: what stands in the table and in the figure."""

from collections.abc import Iterable, Mapping
from typing import Final

from piezod.config.modes import Mode
from piezod.experiment.error_rows import errors_pct
from piezod.hysteresis import tracking_rms
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording import Recording

METRICS: Final = (
    "tracking_max_pct",
    "nonlinearity_pct",
    "true_tracking_max_pct",
    "true_tracking_rms_pct",
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
_COMPUTED_HERE: Final = "true_tracking_rms_pct"

Errors = Mapping[str, Mapping[str, Mapping[str, float]]]
"""Stage → mode → metric → error in % of the range."""


def worst_of_cases(recordings: Iterable[Recording]) -> dict[str, dict[str, float]]:
    """Return mode → metric → the largest error of any case."""
    worst: dict[str, dict[str, float]] = {}
    for recording in recordings:
        of_mode = worst.setdefault(recording.mode, dict.fromkeys(METRICS, 0.0))
        for name, value in _errors(recording).items():
            of_mode[name] = max(of_mode[name], value)
    return worst


def _errors(recording: Recording) -> dict[str, float]:
    counted = slice(recording.first_metric_index, None)
    command_um, true_um = recording.command_um[counted], recording.true_um[counted]
    names = tuple(name for name in METRICS if name != _COMPUTED_HERE)
    errors = errors_pct(names, command_um, recording.position_um[counted], true_um)
    return {**errors, _COMPUTED_HERE: _true_rms_pct(command_um, true_um)}


def _true_rms_pct(command_um: FloatArray, true_um: FloatArray) -> float:
    return 100.0 * tracking_rms(command_um, true_um)


def variants_table(errors: Errors) -> str:
    """Return the true errors of all stages as a table, worst / rms, one row for each stage."""
    rows = [
        [stage, *(_worst_and_rms(modes[mode]) for mode in SHOWN_MODES)]
        for stage, modes in errors.items()
    ]
    return _table(["stage"], SHOWN_MODES, rows)


def _worst_and_rms(values: Mapping[str, float]) -> str:
    return f"{values['true_tracking_max_pct']:.2f} / {values['true_tracking_rms_pct']:.2f}"


def short_table(modes: Mapping[str, Mapping[str, float]]) -> str:
    """Return the errors of one stage that tell most as a table, one row for each mode."""
    rows = [
        [mode, *(f"{values[name]:.2f}" for name in SHORT_COLUMNS)]
        for mode, values in modes.items()
        if mode != STOPS
    ]
    return _table(["mode"], SHORT_COLUMNS.values(), rows)


def _table(texts: list[str], numbers: Iterable[str], rows: Iterable[list[str]]) -> str:
    """Return Markdown: columns of texts at the left, of numbers at the right."""
    heads = [*texts, *numbers]
    rule = ["---"] * len(texts) + ["--:"] * (len(heads) - len(texts))
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (heads, rule, *rows))
