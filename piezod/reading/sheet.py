"""Tables in .xlsx files of Excel and other spreadsheets."""

import warnings
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezod.errors import DataError
from piezod.given_file import open_given
from piezod.reading.checks import fail, shortened
from piezod.reading.extra import library
from piezod.reading.layout import Layout, layout_of, shape_of
from piezod.reading.table import MOST_BYTES, FloatArray, Table
from piezod.reading.text import Dialect

_HEAD_ROWS: Final = 400
_MOST_UNPACKED: Final = 4_000_000_000
_TEXTS: Final = Dialect("\t", ".")
"""How cells that hold a text are read."""


def open_sheet(file: Path, part: str) -> Table:
    """Return the table in the sheet of an .xlsx file that has numbers.

    Args:
        file: The file.
        part: Name of the sheet, as in "/Sheet2"; empty for the only one with numbers.

    Raises:
        DataError: If no sheet has numbers, several have, or openpyxl is not installed.
    """
    openpyxl = library("openpyxl", "an .xlsx file", file)
    layouts: dict[str, Layout] = {}
    with _opened(openpyxl, file) as book:
        for sheet in book.worksheets:
            if part.strip("/") in {"", sheet.title}:
                rows = [list(map(_text, row)) for row in islice(_rows(sheet), _HEAD_ROWS)]
                width = max(map(len, rows), default=0)
                rows = [row + [""] * (width - len(row)) for row in rows]
                shape = shape_of(rows, _TEXTS.is_number)
                if len(shape.numeric) > 1 or (part and shape.numeric):
                    layouts[sheet.title] = layout_of(rows, shape, _TEXTS.is_number)
        names = ", ".join(repr(sheet.title) for sheet in book.worksheets)
    if not layouts:
        raise DataError(f"{file}: no sheet{f' {part}' if part else ''} has a table; has {names}")
    if len(layouts) > 1:
        several = ", ".join(f"{file}:/{title}" for title in layouts)
        raise DataError(f"{file}: {len(layouts)} sheets have numbers; give one of {several}")
    ((title, layout),) = layouts.items()

    def read(numbers: Sequence[int]) -> list[FloatArray]:
        with _opened(openpyxl, file) as book:
            return _values(file, book[title], layout, [layout.numeric[each] for each in numbers])

    said = [f".xlsx, sheet {title!r}"]
    if layout.header is None:
        said.append("no names, so that columns have numbers")
    else:
        said.append(f"names in row {layout.header + 1}")
    if layout.units is not None:
        said.append(f"units in row {layout.units + 1}")
    columns = tuple(layout.columns[number] for number in layout.numeric)
    return Table(
        file, ", ".join(said), columns, read, layout.clock, first=layout.first + 1, counted="row"
    )


@contextmanager
def _opened(openpyxl: Any, file: Path) -> Iterator[Any]:
    with _damage_is_an_error(file):
        with open_given(file, MOST_BYTES) as raw, zipfile.ZipFile(raw) as archive:
            unpacked = sum(each.file_size for each in archive.infolist())
        if unpacked > _MOST_UNPACKED:
            fail(str(file), f"unpacked it has {unpacked} bytes", "allowed are 4 GB", "save as CSV")
        # By its contents, because openpyxl judges the name of a file otherwise.
        with open_given(file, MOST_BYTES) as raw, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about styles and extensions
            book = openpyxl.load_workbook(raw, read_only=True, data_only=True)
            try:
                yield book
            finally:
                book.close()


@contextmanager
def _damage_is_an_error(file: Path) -> Iterator[None]:
    try:
        yield
    except DataError:
        raise
    except Exception as error:  # of XML, of zip, and openpyxl's own
        if isinstance(error, OSError) and error.errno:
            raise
        raise DataError(f"{file}: the .xlsx file is damaged: {error}") from error


def _rows(sheet: Any) -> Iterator[Sequence[Any]]:
    sheet.reset_dimensions()  # some programs write wrong ones
    rows: Iterator[Sequence[Any]] = sheet.iter_rows(values_only=True)
    return rows


def _text(cell: object) -> str:
    return "" if cell is None else str(cell).strip()


def _values(file: Path, sheet: Any, layout: Layout, wanted: list[int]) -> list[FloatArray]:
    values: list[list[float]] = [[] for _ in wanted]
    empty = 0
    for number, row in enumerate(_rows(sheet), start=1):
        if number <= layout.first:
            continue
        cells = [row[column] if column < len(row) else None for column in wanted]
        if all(cell is None for cell in row):
            empty += 1  # at the end there may be many that once had something
            continue
        for column in values:
            column.extend([np.nan] * empty)
        empty = 0
        for column, cell, index in zip(values, cells, wanted, strict=True):
            column.append(_value(file, number, cell, layout.columns[index].name))
    return [np.array(column, dtype=np.float64) for column in values]


def _value(file: Path, number: int, cell: object, name: str) -> float:
    if isinstance(cell, int | float):
        return float(cell)
    try:
        return _TEXTS.number(_text(cell))
    except ValueError:
        what, allowed = f"{name} is {shortened(_text(cell))!r}", "allowed is a number"
        fail(f"{file}: row {number}", what, allowed, "correct or delete the row")
