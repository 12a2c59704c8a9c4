"""Reads the record for a fit from a CSV file or from the recording of a running stage."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezod.errors import DataError
from piezod.experiment.fit.delay import has_one_frequency
from piezod.experiment.fit.even import periods_between
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.recorded import (
    MAX_FILLED,
    MAX_MISSING_SHARE,
    Columns,
    columns_of_recording,
    delay_of_recording,
    told_missing,
)
from piezod.experiment.fit.run_in import mark_unknown_past
from piezod.experiment.prefix import prefix_errors
from piezod.records.csv_checks import MAX_STEP_PERIODS
from piezod.records.csv_file import read_csv
from piezod.records.opened import is_hdf5


class Source(NamedTuple):
    """A record, and what its file says about it."""

    record: Record  #: The record.
    notes: tuple[str, ...]  #: Warnings about the file, a sentence each.
    delay_s: float | None  #: Delay to use instead of an estimate, in s; None to estimate it.


def read_source(path: Path, skip_s: float, axis: str | None = None) -> Source:
    """Return the record in a file, without its first seconds.

    Args:
        path: A CSV file with the columns t_s, drive_v, position_um, or a recording of a stage.
        skip_s: First seconds that do not count.
        axis: Axis of a recording; None for the only one.

    Raises:
        DataError: If the file cannot be used; the text starts with its name.
        OSError: If the file cannot be read.
    """
    recorded = is_hdf5(path)
    columns, notes = columns_of_recording(path, axis) if recorded else columns_of_csv(path)
    with prefix_errors(str(path)):
        record = Record(columns["t_s"], columns["drive_v"], columns["position_um"])
        record = mark_unknown_past(record).after(skip_s)
    delay_s = delay_of_recording(path, axis) if recorded else None
    if delay_s is not None and has_one_frequency(record.drive_v):
        used = (
            f"The drive has one frequency, which does not determine the delay: {1e3 * delay_s:.3g} "
            "ms is used, that of the model which the stage used. Give another with --delay-s."
        )
        return Source(record, (*notes, used), delay_s)
    return Source(record, notes, None)


def columns_of_csv(path: Path) -> tuple[Columns, tuple[str, ...]]:
    """Return the record in a CSV file, evenly in time, and what to know about it.

    Raises:
        DataError: If the file cannot be used; the text starts with its name.
        OSError: If the file cannot be read.
    """
    columns = read_csv(path, max_step_periods=MAX_FILLED + MAX_STEP_PERIODS)
    t_s = columns["t_s"]
    periods = periods_between(t_s)
    missing = int(np.sum(periods - 1))
    if not missing:
        return columns, ()
    samples = t_s.size + missing
    if missing > MAX_MISSING_SHARE * samples:
        raise DataError(
            f"{path}: {missing} of {samples} samples are missing: t_s has gaps; allowed are "
            f"{100 * MAX_MISSING_SHARE:g} %; record again, or cut out a part without gaps"
        )
    # The recorded samples stay as they are; the new ones are between them.
    places = np.concatenate(([0], np.cumsum(periods)))
    even_s = np.interp(np.arange(places[-1] + 1), places, t_s)
    filled = {name: np.interp(even_s, t_s, column) for name, column in columns.items()}
    return filled, told_missing(missing, even_s.size, "t_s has gaps")
