"""The one door for records: reads any known file, and says what was understood."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezod.reading.checks import (
    MAX_STEP_PERIODS,
    Place,
    check_time,
    check_unwrapped,
    check_varies,
    counted,
    fail,
)
from piezod.reading.choices import RECORD, TIME, Choices, Role
from piezod.reading.formats import open_table
from piezod.reading.roles import Chosen, chosen_columns, quantity_of
from piezod.reading.table import Clock, FloatArray, Table

MIN_SAMPLES: Final = 100
"""Smallest number of samples of a useful record; a model with 38 parameters needs far more."""


@dataclass(frozen=True)
class ReadRecord:
    """Columns that were read, with what was understood."""

    columns: dict[str, FloatArray]  #: By the names of the roles, in s, V and µm; each (n_samples,).
    #: What was inferred about the file, a sentence each; empty for a CSV file as piezod writes it.
    understood: tuple[str, ...]
    place: Place  #: Returns where in the file a sample is, as `FILE:LINE`.


def read_record(
    path: Path,
    choices: Choices = Choices(),  # noqa: B008 - frozen
    *,
    roles: Sequence[Role] = RECORD,
    min_samples: int = MIN_SAMPLES,
    max_step_periods: float = MAX_STEP_PERIODS,
    command: str = "identify",
) -> ReadRecord:
    """Return the record in a file of any known format, after checking that it can be used.

    Rows with empty cells are left out, so that they become gaps in time.

    Args:
        path: The file; for HDF5, Excel and TDMS a part may follow, as in `file.h5:/group`.
        choices: What the person says about its columns.
        roles: What is needed: `RECORD`, or `TRAJECTORY`.
        min_samples: Smallest number of samples.
        max_step_periods: Longest time step, in median steps; a longer one is a gap.
        command: The command that needs the record, for the remedy in an error.

    Raises:
        DataError: If the file cannot be used; the text is `place: what, allowed, remedy`.
        OSError: If the file cannot be read.
    """
    table = open_table(path)
    chosen, clock = chosen_columns(table, roles, choices, command)
    columns = _columns(table, chosen)
    if clock is not None:
        columns = {"t_s": _times_s(clock, columns)} | columns
    columns, kept = _without_empty(columns)
    place = _place(table, kept)
    size = kept.size
    if size < min_samples:
        where = place(size - 1) if size else str(table.path)
        allowed = f"allowed are {min_samples} or more"
        what = f"the file ends after {counted(size, 'sample')}"
        fail(where, what, allowed, "record for longer")
    _check(columns, place, max_step_periods)
    return ReadRecord(columns, _understood(table, chosen, clock), place)


def read_series(path: Path, column: str) -> ReadRecord:
    """Return a column of a file over time, in any known format; no row may be empty.

    Args:
        path: The file.
        column: Name of the column, in V or µm if no unit is known.

    Raises:
        DataError: If the file cannot be used; the text is `place: what, allowed, remedy`.
        OSError: If the file cannot be read.
    """
    table = open_table(path)
    role = Role("value", column, quantity_of(table, column), ())
    chosen, clock = chosen_columns(table, (TIME, role), Choices({"value": column}), "import")
    columns = _columns(table, chosen)
    if clock is not None:
        columns = {"t_s": _times_s(clock, columns)} | columns
    _, kept = _without_empty(columns)
    if kept.size < columns["t_s"].size:
        missing = int(np.setdiff1d(np.arange(columns["t_s"].size), kept)[0])
        remedy = "write a number, or delete the row"
        fail(table.place(missing), "the row has an empty cell", "allowed are numbers", remedy)
    return ReadRecord(columns, _understood(table, chosen, clock), table.place)


def _columns(table: Table, chosen: list[Chosen]) -> dict[str, FloatArray]:
    read = table.read([each.number for each in chosen])
    sizes = {values.size for values in read}
    if len(sizes) > 1:
        lengths = (
            f"{table.columns[each.number].name} {values.size}"
            for each, values in zip(chosen, read, strict=True)
        )
        what = f"the columns differ in length: {', '.join(lengths)}"
        fail(str(table.path), what, "allowed is one length", "export them together, or cut them")
    columns = {}
    for each, values in zip(chosen, read, strict=True):
        as_read = (each.factor, each.offset) == (1.0, 0.0)
        columns[each.role.name] = values if as_read else _scaled(values, each)
    return columns


def _scaled(values: FloatArray, chosen: Chosen) -> FloatArray:
    # A decimal fraction divides exactly where its inverse does not multiply so: 5 ms is 0.005 s.
    inverse = 1.0 / chosen.factor
    divides = abs(inverse) > 1.0 and abs(inverse - round(inverse)) < 1e-9 * abs(inverse)
    scaled = values / round(inverse) if divides else values * chosen.factor
    return np.asarray(scaled + chosen.offset, dtype=np.float64)


def _times_s(clock: Clock, columns: dict[str, FloatArray]) -> FloatArray:
    size = next(iter(columns.values())).size
    return clock.start_s + np.arange(size, dtype=np.float64) * np.float64(clock.interval_s)


def _without_empty(
    columns: dict[str, FloatArray],
) -> tuple[dict[str, FloatArray], NDArray[np.intp]]:
    """Return the rows without an empty cell, and their numbers."""
    full = ~np.any([np.isnan(values) for values in columns.values()], axis=0)
    kept = np.flatnonzero(full)
    if kept.size < full.size:
        columns = {name: values[kept] for name, values in columns.items()}
    return columns, kept


def _place(table: Table, kept: NDArray[np.intp]) -> Place:
    return lambda index: table.place(int(kept[index]))


def _check(columns: dict[str, FloatArray], place: Place, max_step_periods: float) -> None:
    for name, values in columns.items():
        infinite = np.flatnonzero(np.isinf(values))
        if infinite.size:
            what = f"{name} is {values[infinite[0]]}"
            remedy = "cut the record there, or fill in the measured value"
            fail(place(int(infinite[0])), what, "allowed is any finite number", remedy)
    check_time(columns["t_s"], place, max_step_periods)
    if "drive_v" in columns and "position_um" in columns:
        for name in ("drive_v", "position_um"):
            check_varies(name, columns[name], place)
        check_unwrapped(columns["drive_v"], columns["position_um"], place)


def _understood(table: Table, chosen: list[Chosen], clock: Clock | None) -> tuple[str, ...]:
    said = [each.said for each in chosen if each.said]
    if clock is not None:
        said.insert(0, f"t_s counts the samples: {clock.said}")
    later = tuple(table.found_later)
    if table.plain and not said and not later:
        return ()
    form = ", ".join((table.form, *later))
    return (f"{form}.", *(f"{each}." for each in said))
