"""The table of errors: the best mode of each case, and errors above their reference."""

import math
from collections.abc import Mapping, Sequence
from itertools import chain, groupby
from typing import Final, NamedTuple

from piezod.records.experiment_result import ExperimentResult, Recording
from piezod.records.labels import metric_group
from piezod.records.reference import Reference, is_missed

_MEANINGS: Final = {
    "measured": "Measured: from the sensor.",
    "true": "True: from the simulated stage.",
    "noise": "Noise: sensor error without its lag and calibration error.",
}


class ErrorCell(NamedTuple):
    """One error."""

    metric: str  #: Name of the metric.
    value: float  #: The error in the unit of the name; NaN if the recording lacks this metric.
    limit: float | None  #: Reference that it must not exceed; None if there is none.
    #: Whether no other mode of the case has a smaller error; False for noise, which does not depend
    #: on the mode.
    best: bool
    missed: bool  #: Whether it exceeds its limit, or is NaN although it has one.


class ErrorRow(NamedTuple):
    """The errors of one recording."""

    mode: str  #: Name of the mode.
    cells: tuple[ErrorCell, ...]  #: One for each metric of the experiment.
    reference: (
        float | None
    )  #: Error of the reference for this case and mode; None if there is none.


def error_table(
    result: ExperimentResult, reference: Reference | None = None
) -> dict[tuple[str, str], tuple[ErrorRow, ...]]:
    """Return the errors of an experiment: rows of modes by (axis, case)."""
    return {
        key: tuple(_row(each, recordings, result.metric_names, reference) for each in recordings)
        for key, recordings in result.by_case().items()
    }


def groups(metrics: Sequence[str]) -> list[tuple[str, tuple[str, ...]]]:
    """Return neighbouring metrics of the same group, with the name of the group."""
    return [(group, tuple(names)) for group, names in groupby(metrics, key=metric_group)]


def meaning(metrics: Sequence[str]) -> str:
    """Return a sentence on each group of metrics."""
    of_groups = [_MEANINGS[group] for group in dict.fromkeys(map(metric_group, metrics))]
    return " ".join(("Errors are in % of the displacement's range.", *of_groups))


def verdict(
    table: Mapping[tuple[str, str], Sequence[ErrorRow]], reference: Reference | None = None
) -> str:
    """Return a sentence that compares the errors with the reference; empty without one.

    Args:
        table: From `error_table`, with the same reference.
        reference: Errors to compare with.
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
        # A comparison with NaN is false, so a mode without this error is never the best.
        best = bool(others) and all(value <= other for other in others)
        best = best and metric_group(metric) != "noise"
        cells.append(ErrorCell(metric, value, limit, best, is_missed(value, limit)))
    return ErrorRow(recording.mode, tuple(cells), reference.value(recording) if reference else None)
