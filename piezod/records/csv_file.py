"""CSV input and output: named columns of numbers over time, `t_s, drive_v, position_um, …`."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
import numpy.typing as npt

from piezod.given_file import read_given
from piezod.records.atomic import replacing
from piezod.records.csv_checks import (
    FIRST_DATA_LINE,
    MAX_STEP_PERIODS,
    check_finite,
    check_time,
    check_varies,
    counted,
    fail,
    shortened,
)
from piezod.records.frozen import FloatArray

MIN_SAMPLES: Final = 100
"""Smallest number of samples of a useful record; a model with 38 parameters needs far more."""

_MUST_VARY: Final = ("drive_v", "position_um")
_HEADER_LINE: Final = 1
MOST_BYTES: Final = 512_000_000
"""Largest size of a file: 20 million samples of a usual record."""
LONGEST_LINE: Final = 65_536
"""Longest line, in bytes."""
MOST_COLUMNS: Final = 1000


def read_csv(
    path: Path,
    required: Sequence[str] = ("t_s", "drive_v", "position_um"),
    min_samples: int = MIN_SAMPLES,
    max_step_periods: float = MAX_STEP_PERIODS,
) -> dict[str, FloatArray]:
    """Return recorded columns, after checking that they can be used.

    The file is UTF-8 text, comma separated: a header of column names, then one row per sample,
    evenly spaced in time except for jitter. A byte order mark, all line ends, and fields in
    quotation marks are accepted. Columns that are not required are neither read nor checked.

    Args:
        path: Path of the file.
        required: Names of the columns to read.
        min_samples: Smallest number of samples.
        max_step_periods: Longest time step, in median steps; a longer one is a gap.

    Returns:
        The required columns by name, each of shape (n_samples,), exactly as written.

    Raises:
        DataError: If the file breaks a rule; the text is `file:line: what, allowed, remedy`.
        OSError: If the file cannot be read.
    """
    lines = _lines(path)
    header = [name.strip() for name in lines[0].split(",")]
    _check_header(path, header, required)
    rows = lines[1:]
    _check_widths(path, rows, len(header))
    table = _parse(path, rows, header, required)
    if len(table) < min_samples:
        fail(
            path,
            len(lines),
            f"the file ends after {counted(len(table), 'sample')}",
            f"allowed are {min_samples} or more",
            "record for longer",
        )
    columns = dict(zip(required, np.ascontiguousarray(table.T), strict=True))
    if "t_s" in columns:
        check_time(path, columns["t_s"], max_step_periods)
    for name in _MUST_VARY:
        if name in columns:
            check_varies(path, name, columns[name])
    return columns


def write_csv(path: Path, columns: Mapping[str, npt.ArrayLike]) -> None:
    """Write columns such that reading them returns the same numbers to the last bit.

    Args:
        path: Path of the file; it is written completely or not at all.
        columns: Columns by name, each of shape (n_samples,): numbers, or texts without commas.

    Raises:
        ValueError: If the columns differ in length.
        OSError: If the file cannot be written.
    """
    write_csv_portions(path, [columns])


def write_csv_portions(path: Path, portions: Iterable[Mapping[str, npt.ArrayLike]]) -> None:
    """Write columns that come in portions; arguments and errors are those of `write_csv`."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        for number, columns in enumerate(portions):
            if not number:
                file.write(",".join(columns) + "\n")
            rows = map(",".join, zip(*map(_texts, columns.values()), strict=True))
            file.writelines(f"{row}\n" for row in rows)


def _texts(column: npt.ArrayLike) -> list[str]:
    values = np.asarray(column)
    if values.dtype.kind == "b":
        values = values.astype(np.int8)  # 0 and 1, which every program reads as numbers
    # repr is the shortest text that reads back as the same double.
    spell = repr if values.dtype.kind == "f" else str
    return [spell(value) for value in values.tolist()]


def _lines(path: Path) -> list[str]:
    raw = read_given(path, MOST_BYTES)
    _check_lines(path, raw)
    try:
        text = raw.decode("utf-8-sig")  # spreadsheets put a byte order mark first
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        fail(path, line, "this is not UTF-8 text", "allowed is CSV in UTF-8", "save it as such")
    # splitlines also splits at form feeds and other characters; an editor counts lines otherwise.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if '"' in text:
        lines = _unquoted(path, lines)
    if not lines:
        remedy = "begin with a line such as t_s,drive_v,position_um"
        fail(path, _HEADER_LINE, "the file is empty", "allowed is a header and samples", remedy)
    return lines


def _unquoted(path: Path, lines: list[str]) -> list[str]:
    rows = csv.reader(lines)
    try:
        return [",".join(fields) for fields in rows]
    except csv.Error as error:
        remedy = "delete the quotation marks"
        fail(path, rows.line_num, str(error), "allowed are quotation marks in pairs", remedy)


def _check_lines(path: Path, raw: bytes) -> None:
    """Refuse a line that is too long, before it is split."""
    begin = 0
    while len(raw) - begin > LONGEST_LINE:
        end = max(raw.rfind(sign, begin, begin + LONGEST_LINE + 1) for sign in (b"\n", b"\r"))
        if end < begin:
            line = raw[:begin].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n") + 1
            what = f"the line has more than {LONGEST_LINE} bytes"
            remedy = f"write one row per sample, with at most {MOST_COLUMNS} columns"
            fail(path, line, what, f"allowed are {LONGEST_LINE}", remedy)
        begin = end + 1


def _check_header(path: Path, header: list[str], required: Sequence[str]) -> None:
    if len(header) > MOST_COLUMNS:
        what = f"the header has {len(header)} columns"
        remedy = f"keep those that are needed: {', '.join(required)}"
        fail(path, _HEADER_LINE, what, f"allowed are {MOST_COLUMNS}", remedy)
    found = "found " + shortened(", ".join(repr(name) for name in header))
    repeated = sorted({name for name in header if header.count(name) > 1})
    if repeated:
        what = f"column {repeated[0]!r} appears {header.count(repeated[0])} times"
        fail(path, _HEADER_LINE, what, f"{found}; allowed is once", "delete or rename one")
    missing = [name for name in required if name not in header]
    if not missing:
        return
    what = "no column " + ", ".join(repr(name) for name in missing)
    # The usual cause: a spreadsheet of a country with a decimal comma.
    other = next((name for name in (";", "\t") if name in "".join(header)), None)
    if other:
        remedy = f"separate columns by commas, not by {other!r}, and write decimals with a point"
    else:
        remedy = "name the columns so in the first line, with the units that the names say"
    fail(path, _HEADER_LINE, what, f"{found}; needed are {', '.join(required)}", remedy)


def _check_widths(path: Path, rows: list[str], width: int) -> None:
    for number, row in enumerate(rows, FIRST_DATA_LINE):
        if row.count(",") != width - 1 or not row.strip():
            n_fields = row.count(",") + 1 if row.strip() else 0
            what = f"the row has {counted(n_fields, 'field')}"
            remedy = "complete or delete the row; decimals have a point, not a comma"
            fail(path, number, what, f"allowed are {width} as in the header", remedy)


def _parse(path: Path, rows: list[str], header: list[str], required: Sequence[str]) -> FloatArray:
    indices = [header.index(name) for name in required]
    if not rows:
        return np.empty((0, len(required)))
    try:
        table = _numbers(rows, indices)
    except ValueError:
        # The message of the parser does not say enough, so the row is found here.
        first_bad = _first_not_numeric(rows, indices)
        if first_bad:  # a NaN above that row is the first error of the file
            check_finite(path, _numbers(rows[:first_bad], indices), required)
        _fail_not_numeric(path, first_bad, rows[first_bad], header, required)
    check_finite(path, table, required)
    return table


def _numbers(rows: list[str], indices: list[int]) -> FloatArray:
    return np.loadtxt(rows, delimiter=",", comments=None, usecols=indices, ndmin=2)


def _first_not_numeric(rows: list[str], indices: list[int]) -> int:
    # Bisection with the parser itself finds the row that it refuses, at the cost of one more read.
    low, high = 0, len(rows)
    while high - low > 1:
        middle = (low + high) // 2
        try:
            _numbers(rows[low:middle], indices)
            low = middle
        except ValueError:
            high = middle
    return low


def _fail_not_numeric(
    path: Path, index: int, row: str, header: list[str], required: Sequence[str]
) -> NoReturn:
    name = next(name for name in required if not _is_number(row, header.index(name)))
    text = shortened(row.split(",")[header.index(name)].strip())
    what = f"{name} is {text!r}" if text else f"{name} is empty"
    remedy = "correct or delete the row"
    fail(path, index + FIRST_DATA_LINE, what, "allowed is a number such as -1.25e-3", remedy)


def _is_number(row: str, index: int) -> bool:
    try:
        _numbers([row], [index])
    except ValueError:
        return False
    return True
