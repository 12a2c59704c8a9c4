"""Reads the record for a fit from a table of others or from the recording of a running stage."""

from pathlib import Path
from typing import Final, NamedTuple

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
from piezod.reading.checks import MAX_STEP_PERIODS
from piezod.reading.choices import Choices
from piezod.reading.record import read_record
from piezod.records.recording.reader import is_recording


class Source(NamedTuple):
    """A record, and what its file says about it."""

    record: Record  #: The record.
    notes: tuple[str, ...]  #: Warnings about the file, a sentence each.
    delay_s: float | None  #: Delay to use instead of an estimate, in s; None to estimate it.
    understood: tuple[str, ...] = ()  #: What was inferred about the file, a sentence each.


NO_CHOICES: Final = Choices()


def read_source(
    path: Path,
    skip_s: float,
    axis: str | None = None,
    choices: Choices = NO_CHOICES,
    command: str = "identify",
) -> Source:
    """Return the record in a file, without its first seconds.

    Args:
        path: A table of time, drive and position in any known format, or a recording of a stage.
        skip_s: First seconds that do not count.
        axis: Axis of a recording; None for the only one.
        choices: What the person says about the columns of a table.
        command: The command that needs it, for the remedy in an error.

    Raises:
        DataError: If the file cannot be used; the text starts with its name.
        OSError: If the file cannot be read.
    """
    recorded = is_recording(path)
    if recorded:
        _refuse_choices(path, choices)
        columns, notes = columns_of_recording(path, axis)
        understood: tuple[str, ...] = ()
    else:
        columns, notes, understood = columns_of_table(path, choices, command)
    with prefix_errors(str(path)):
        record = Record(columns["t_s"], columns["drive_v"], columns["position_um"])
        record = mark_unknown_past(record).after(skip_s)
    delay_s = delay_of_recording(path, axis) if recorded else None
    if delay_s is not None and has_one_frequency(record.drive_v):
        used = (
            f"The drive has one frequency, which does not determine the delay: {1e3 * delay_s:.3g} "
            "ms is used, that of the model which the stage used. Give another with --delay-s."
        )
        return Source(record, (*notes, used), delay_s, understood)
    return Source(record, notes, None, understood)


def _refuse_choices(path: Path, choices: Choices) -> None:
    if choices:
        raise DataError(
            f"{path}: this is a recording of a stage, whose columns are known; leave out "
            "--columns, --scale, --offset, --invert and --rate-hz"
        )


def columns_of_table(
    path: Path, choices: Choices = NO_CHOICES, command: str = "identify"
) -> tuple[Columns, tuple[str, ...], tuple[str, ...]]:
    """Return the record in a table, evenly in time; what to know, and what was inferred about it.

    Args:
        path: A table of time, drive and position in any known format.
        choices: What the person says about its columns.
        command: The command that needs it, for the remedy in an error.

    Raises:
        DataError: If the file cannot be used; the text starts with its name.
        OSError: If the file cannot be read.
    """
    longest = MAX_FILLED + MAX_STEP_PERIODS
    read = read_record(path, choices, max_step_periods=longest, command=command)
    columns, understood = read.columns, read.understood
    t_s = columns["t_s"]
    periods = periods_between(t_s)
    missing = int(np.sum(periods - 1))
    if not missing:
        return columns, (), understood
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
    return filled, told_missing(missing, even_s.size, "t_s has gaps"), understood
