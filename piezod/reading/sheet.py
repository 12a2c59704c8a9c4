"""Tables in .xlsx files of Excel and other spreadsheets."""

import warnings
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
_MOST_ROWS: Final = 1_048_576
"""Rows of a sheet of Excel; a file may name higher ones, before which there are empty ones."""
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
                head = islice(_rows(file, sheet), _HEAD_ROWS)
                rows = [list(map(_text, row)) for row in head]
                width = max(map(len, rows), default=0)
                rows = [row + [""] * (width - len(row)) for row in rows]
                shape = shape_of(rows, _is_number)
                if len(shape.numeric) > 1 or (part and shape.numeric):
                    layouts[sheet.title] = layout_of(rows, shape, _is_number)
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
    # By its contents, because openpyxl judges the name of a file otherwise.
    with _damage_is_an_error(file), open_given(file, MOST_BYTES) as raw, warnings.catch_warnings():
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


def _rows(file: Path, sheet: Any) -> Iterator[Sequence[Any]]:
    sheet.reset_dimensions()  # some programs write wrong ones
    for number, row in enumerate(sheet.iter_rows(values_only=True)):
        if number == _MOST_ROWS:
            what = f"sheet {sheet.title!r} has more than {_MOST_ROWS} rows"
            fail(str(file), what, f"allowed are {_MOST_ROWS}", "save it as CSV")
        yield row


def _text(cell: object) -> str:
    return "" if cell is None else str(cell).strip()


def _is_number(cell: str) -> bool:
    return _TEXTS.is_number(cell.replace(",", ".")) or _TEXTS.is_number(cell)


def _values(file: Path, sheet: Any, layout: Layout, wanted: list[int]) -> list[FloatArray]:
    values: list[list[float]] = [[] for _ in wanted]
    empty = 0
    for number, row in enumerate(_rows(file, sheet), start=1):
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
    text, allowed, remedy = _text(cell), "allowed is a number", "correct or delete the row"
    try:
        value = _TEXTS.number(text)
    except ValueError:
        value = None
    if "," in text and _is_number(text):  # nobody knows whether 10,018 is ten or ten thousand
        value, remedy = None, "it is a text: turn the column into numbers, or save it as CSV"
    if value is None:
        fail(f"{file}: row {number}", f"{name} is {shortened(text)!r}", allowed, remedy)
    return value
