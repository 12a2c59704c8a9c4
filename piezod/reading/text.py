"""Tables in text files: any separator, decimal sign and encoding, with or without a header."""

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from piezod.errors import DataError
from piezod.given_file import open_given
from piezod.reading.checks import counted, fail, shortened
from piezod.reading.layout import EMPTY, Layout, Shape, layout_of, shape_of
from piezod.reading.table import MOST_BYTES, MOST_COLUMNS, FloatArray, Table

LONGEST_LINE: Final = 65_536
"""Longest line, in characters."""
_HEAD_BYTES: Final = 262_144
_PORTION: Final = 8_000_000
"""Characters that are parsed at once; memory for some ten times as much is needed."""
_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_SEPARATORS: Final = (",", ";", "\t", "|", None)
"""Separators of cells, the likely ones first; None for any number of spaces."""
_NAMES: Final = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", None: "spaces"}
_PLAIN: Final = "CSV: UTF-8, separated by commas, names in line 1"
_FEW: Final = 500
"""Lines that are read one by one where the fast reader refuses them."""
_GROUPED: Final = "thousands are grouped"


def _number_pattern(decimal: str, group: str) -> re.Pattern[str]:
    point, comma = re.escape(decimal), re.escape(group)
    grouped = rf"[1-9]\d{{0,2}}({comma}\d{{3}})+({point}\d*)?"
    return re.compile(
        rf"[-+]?({grouped}|(\d+({point}\d*)?|{point}\d+)(e[-+]?\d+)?|inf|infinity|nan)",
        re.ASCII | re.IGNORECASE,
    )


_PATTERNS: Final = {".": _number_pattern(".", ","), ",": _number_pattern(",", ".")}


class Dialect(NamedTuple):
    """How a text file is written."""

    separator: str | None  #: Between cells; None for any number of spaces.
    decimal: str  #: "." or ",".

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line, without quotation marks."""
        if self.separator is None:
            return line.split()
        if '"' in line:
            return [each.strip() for each in next(csv.reader([line], delimiter=self.separator))]
        return [each.strip() for each in line.split(self.separator)]

    def is_number(self, cell: str) -> bool:
        """Return whether a cell is a number."""
        return _PATTERNS[self.decimal].fullmatch(cell) is not None

    def number(self, cell: str) -> float:
        """Return the value of a cell; NaN if it is empty.

        Raises:
            ValueError: If it is no number.
        """
        if cell.lower() in EMPTY:
            return np.nan
        if not self.is_number(cell):
            raise ValueError(cell)
        return float(cell.replace("," if self.decimal == "." else ".", "").replace(",", "."))


def open_text(path: Path) -> Table:
    """Return the table in a text file.

    Raises:
        DataError: If the file has no table of numbers, or is not text.
        OSError: If it cannot be read.
    """
    encoding, lines = _head(path)
    if not lines:
        remedy = "begin with a line such as t_s,drive_v,position_um"
        fail(f"{path}:1", "the file is empty", "allowed is a header and samples", remedy)
    dialect, rows, shape = _dialect(lines)
    if not shape.numeric:
        what = f"there are no rows of numbers; the file begins with {shortened(lines[0])!r}"
        remedy = "give a record of voltage and position over time"
        fail(f"{path}:1", what, "allowed is a table of numbers", remedy)
    if shape.width > MOST_COLUMNS:
        what, allowed = f"the rows have {shape.width} columns", f"allowed are {MOST_COLUMNS}"
        fail(f"{path}:1", what, allowed, "keep those that are needed, one row per sample")
    layout = layout_of(rows, shape, dialect.is_number)
    form = _form(encoding, dialect, layout)
    text = _Text(path, encoding, dialect, layout)
    return Table(
        path=path,
        form=form,
        columns=tuple(layout.columns[number] for number in layout.numeric),
        read=text.read,
        clock=layout.clock,
        first=layout.first + 1,
        counted="line",
        plain=form == _PLAIN,
        found_later=text.found_later,
    )


def _form(encoding: str, dialect: Dialect, layout: Layout) -> str:
    parts = [
        {"utf-8-sig": "UTF-8"}.get(encoding, encoding.upper()),
        f"separated by {_NAMES[dialect.separator]}",
    ]
    if dialect.decimal == ",":
        parts.append("decimal comma")
    if layout.header is None:
        parts.append("no names, so that columns have numbers")
    else:
        parts.append(f"names in line {layout.header + 1}")
    if layout.units is not None:
        parts.append(f"units in line {layout.units + 1}")
    return "CSV: " + ", ".join(parts)


def _head(path: Path) -> tuple[str, list[str]]:
    """Return the encoding of a file, and its first lines."""
    with open_given(path, MOST_BYTES) as file:
        raw = file.read(_HEAD_BYTES)
    encoding = next((name for mark, name in _MARKS if raw.startswith(mark)), "utf-8")
    if encoding == "utf-8" and b"\0" in raw:
        # Text of half the bytes zero is UTF-16 without its mark.
        encoding = "utf-16-le" if raw[1:200:2].count(0) > raw[0:200:2].count(0) else "utf-16-be"
        if 4 * raw.count(0) < len(raw):
            _refuse_binary(path)
    whole = len(raw) < _HEAD_BYTES
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(raw, final=whole)
    except UnicodeDecodeError:
        encoding, text = "cp1252", raw.decode("cp1252", errors="replace")
    # splitlines also splits at form feeds and other characters; an editor counts lines otherwise.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not whole and len(lines) > 1:
        lines.pop()  # only a part of it was read
    for number, line in enumerate(lines, start=1):
        _check_length(path, number, line)
    while lines and not lines[-1].strip():
        lines.pop()
    return encoding, lines


def _check_length(path: Path, number: int, line: str) -> None:
    if len(line) > LONGEST_LINE:
        what = f"the line has more than {LONGEST_LINE} characters"
        remedy = f"write one row per sample, with at most {MOST_COLUMNS} columns"
        fail(f"{path}:{number}", what, f"allowed are {LONGEST_LINE}", remedy)


def _refuse_binary(path: Path) -> None:
    what, allowed = "the file is neither text nor of a known format", "allowed are tables"
    fail(str(path), what, allowed, "export the record as CSV, .xlsx, .mat, .npz or HDF5")


def _dialect(lines: Sequence[str]) -> tuple[Dialect, list[list[str]], Shape]:
    """Return the dialect in which most cells are numbers, and the rows in it.

    Raises:
        DataError: If quotation marks are not in pairs.
    """
    best: tuple[tuple[int, ...], Dialect, list[list[str]], Shape] | None = None
    for separator in _SEPARATORS:
        if separator is not None and not any(separator in line for line in lines):
            continue
        for decimal in (".", ","):
            dialect = Dialect(separator, decimal)
            rows = [dialect.cells(line) for line in lines]
            shape = shape_of(rows, dialect.is_number)
            # As many numbers as possible, few other cells, and no more grouped ones than needed.
            other = "," if decimal == "." else "."
            usual = ([row[k] for k in shape.numeric] for row in rows if len(row) == shape.width)
            # Names and units above the numbers say nothing.
            cells = [x for row in usual if any(map(dialect.is_number, row)) for x in row]
            others = sum(not dialect.is_number(cell) for cell in cells)
            grouped = sum(other in cell for cell in cells)
            score = (len(shape.numeric), -shape.words, -others, -grouped)
            if best is None or score > best[0]:
                best = score, dialect, rows, shape
    assert best is not None  # noqa: S101 - spaces are always tried
    return best[1:]


class _Text:
    """The numbers of a text file, which are read when it is known which ones are needed."""

    def __init__(self, path: Path, encoding: str, dialect: Dialect, layout: Layout) -> None:
        self.found_later: list[str] = []
        self._path, self._encoding, self._dialect = path, encoding, dialect
        self._layout = layout

    def read(self, columns: Sequence[int]) -> list[FloatArray]:
        """Return columns by their numbers among those with numbers."""
        wanted = [self._layout.numeric[column] for column in columns]
        try:
            parts = list(self._portions(wanted))
        except UnicodeDecodeError:
            if self._encoding != "utf-8":
                raise DataError(f"{self._path}: this is not {self._encoding} text") from None
            # The only sign that is not UTF-8 comes late, as in a remark.
            self._encoding = "cp1252"
            self.found_later.append("the encoding is CP1252")
            parts = list(self._portions(wanted))
        return [np.concatenate([part[:, k] for part in parts]) for k in range(len(wanted))]

    def _portions(self, wanted: list[int]) -> Iterator[FloatArray]:
        number, blank = self._layout.first + 1, 0
        yield np.empty((0, len(wanted)))
        for lines in self._lines():
            if blank and any(line.strip() for line in lines):
                self._refuse_width(blank, "")
            kept = len(lines)
            while kept and not lines[kept - 1].strip():
                kept -= 1
            if kept < len(lines):
                blank = blank or number + kept
            self._check_widths(number, lines[:kept])
            if kept:
                yield self._numbers(number, lines[:kept], wanted)
            number += len(lines)

    def _lines(self) -> Iterator[list[str]]:
        errors = "replace" if self._encoding == "cp1252" else "strict"
        raw = open_given(self._path, MOST_BYTES)
        with TextIOWrapper(raw, encoding=self._encoding, errors=errors) as stream:
            for _ in range(self._layout.first):
                stream.readline()
            while text := stream.read(_PORTION) + stream.readline(LONGEST_LINE + 1):
                lines = text.split("\n")
                if not lines[-1]:
                    lines.pop()
                yield lines

    def _check_widths(self, number: int, lines: list[str]) -> None:
        separator, widths = self._dialect.separator, self._layout.widths
        if separator is None:
            found = [len(line.split()) for line in lines]
        else:
            found = [line.count(separator) + 1 for line in lines]
        if set(found) <= widths and len(lines) == sum(map(bool, map(str.strip, lines))):
            return
        for index, line in enumerate(lines):
            _check_length(self._path, number + index, line)
            if len(self._dialect.cells(line)) not in widths or not line.strip():
                self._refuse_width(number + index, line)

    def _refuse_width(self, number: int, line: str) -> None:
        n_fields = len(self._dialect.cells(line)) if line.strip() else 0
        allowed = f"allowed are {max(self._layout.widths)} as in the other rows"
        what, remedy = f"the row has {counted(n_fields, 'field')}", "complete or delete the row"
        fail(f"{self._path}:{number}", what, allowed, remedy)

    def _numbers(self, number: int, lines: list[str], wanted: list[int]) -> FloatArray:
        plain: Sequence[str] | None = lines
        if self._dialect.decimal == ",":
            text = "\n".join(lines)
            plain = None if "." in text else text.replace(",", ".").split("\n")
        if plain is not None:
            try:
                return self._plain_numbers(plain, wanted)
            except ValueError:
                if len(lines) > _FEW:  # only those round an empty cell or a word are read slowly
                    half = len(lines) // 2
                    above = self._numbers(number, lines[:half], wanted)
                    below = self._numbers(number + half, lines[half:], wanted)
                    return np.concatenate((above, below))
        cells = self._dialect.cells
        rows = [[each[column] for column in wanted] for each in map(cells, lines)]
        return self._converted(number, rows, wanted)

    def _plain_numbers(self, lines: Sequence[str], wanted: list[int]) -> FloatArray:
        return np.loadtxt(
            lines,
            delimiter=self._dialect.separator,
            quotechar='"',
            comments=None,
            usecols=wanted,
            ndmin=2,
        )

    def _converted(self, number: int, rows: list[list[str]], wanted: list[int]) -> FloatArray:
        value = self._dialect.number
        try:
            table = np.array([[value(cell) for cell in row] for row in rows])
        except ValueError:
            self._refuse_cell(number, rows, wanted)
        group = "," if self._dialect.decimal == "." else "."
        if _GROUPED not in self.found_later and any(group in each for row in rows for each in row):
            self.found_later.append(_GROUPED)
        return table

    def _refuse_cell(self, number: int, rows: list[list[str]], wanted: list[int]) -> None:
        for index, row in enumerate(rows):
            for column, cell in zip(wanted, row, strict=True):
                if cell.lower() not in EMPTY and not self._dialect.is_number(cell):
                    what = f"{self._layout.columns[column].name} is {shortened(cell)!r}"
                    allowed = "allowed is a number such as -1.25e-3"
                    place = f"{self._path}:{number + index}"
                    fail(place, what, allowed, "correct or delete the row")
