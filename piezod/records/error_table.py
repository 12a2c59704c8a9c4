"""The table of errors: which are best, and which miss their reference."""

import math
from collections.abc import Mapping, Sequence
from itertools import chain, groupby
from typing import Final, NamedTuple

from piezod.records.labels import metric_group
from piezod.records.recording import ExperimentResult, Recording
from piezod.records.reference import Reference, is_missed

_MEANINGS: Final = {
    "measured": "Measured: as the sensor shows it.",
    "true": "True: as the simulated stage knows it.",
    "noise": "Noise: what the sensor adds, but for its lag and calibration.",
}


class ErrorCell(NamedTuple):
    """One error.

    Attributes:
        metric: Name of the metric.
        value: The error in the unit of the name; NaN where the recording has no such metric.
        limit: What it should not exceed, None where nothing is said.
        best: Whether no other mode of the case does better; noise is no merit of a mode.
        missed: Whether it exceeds its limit, or is no number where it has one.
    """

    metric: str
    value: float
    limit: float | None
    best: bool
    missed: bool


class ErrorRow(NamedTuple):
    """The errors of one recording.

    Attributes:
        mode: Name of the mode.
        cells: One for each metric of the experiment.
        reference: The reference's error for this case and mode, None where there is none.
    """

    mode: str
    cells: tuple[ErrorCell, ...]
    reference: float | None


def error_table(
    result: ExperimentResult, reference: Reference | None = None
) -> dict[tuple[str, str], tuple[ErrorRow, ...]]:
    """Return the errors of an experiment, rows of modes by (axis, case).

    Args:
        result: The experiment.
        reference: Errors to compare with, where there are any.
    """
    return {
        key: tuple(_row(each, recordings, result.metric_names, reference) for each in recordings)
        for key, recordings in result.by_case().items()
    }


def groups(metrics: Sequence[str]) -> list[tuple[str, tuple[str, ...]]]:
    """Return metrics side by side that are errors of the same, with what that is.

    Args:
        metrics: Names of metrics, in the order of the table.
    """
    return [(group, tuple(names)) for group, names in groupby(metrics, key=metric_group)]


def meaning(metrics: Sequence[str]) -> str:
    """Say in a sentence for each group what the metrics are errors of.

    Args:
        metrics: Names of metrics, in the order of the table.
    """
    of_groups = [_MEANINGS[group] for group in dict.fromkeys(map(metric_group, metrics))]
    return " ".join(("Errors are in % of the displacement's range.", *of_groups))


def verdict(
    table: Mapping[tuple[str, str], Sequence[ErrorRow]], reference: Reference | None = None
) -> str:
    """Say in one sentence how the errors compare with the reference; empty without one.

    Args:
        table: From `error_table`, with the same reference.
        reference: What the errors are compared with.
    """
    rows = chain.from_iterable(table.values())
    compared = [cell for row in rows for cell in row.cells if cell.limit is not None]
    if reference is None or not compared:
        return ""
    n_missed = sum(cell.missed for cell in compared)
    errors = " and ".join(dict.fromkeys(metric_group(cell.metric) for cell in compared)) + " errors"
    if n_missed:
        return f"{n_missed} of {len(compared)} {errors} exceed the figure of the {reference.label}."
    return f"All {len(compared)} {errors} are at or below the figures of the {reference.label}."


def _row(
    recording: Recording,
    rivals: Sequence[Recording],
    metrics: Sequence[str],
    reference: Reference | None,
) -> ErrorRow:
    cells = []
    for metric in metrics:
        value = recording.metrics.get(metric, math.nan)
        limit = reference.limit(recording, metric) if reference else None
        others = [rival.metrics.get(metric, math.inf) for rival in rivals if rival is not recording]
        best = bool(others) and all(value <= other for other in others)
        best = best and metric_group(metric) != "noise"
        cells.append(ErrorCell(metric, value, limit, best, is_missed(value, limit)))
    return ErrorRow(recording.mode, tuple(cells), reference.value(recording) if reference else None)
