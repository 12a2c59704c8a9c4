"""Where the numbers begin in rows of cells, and what the rows above them say."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from piezod.reading.table import Clock, Column
from piezod.reading.units import unit_of

Row = Sequence[str]

EMPTY: Final = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---"))
"""Cells without a value, in small letters."""
_SAMPLED: Final = 100
_UNITS_OF_TIME: Final = ("horizontal units", "x units", "x unit", "x_unit_label")
_UNITS_OF_OTHERS: Final = ("vertical units", "y units", "y unit", "y_unit_label")
_INTERVALS: Final = ("sample interval", "sampling interval", "delta_x", "x increment", "xincr")
_STARTS: Final = ("x0", "x origin", "xorigin")


class Layout(NamedTuple):
    """How rows of cells are to be read."""

    first: int  #: Index of the first row of numbers.
    columns: tuple[Column, ...]  #: All columns, those without numbers too.
    numeric: tuple[int, ...]  #: Which of them have numbers.
    widths: frozenset[int]  #: Numbers of cells that a row of numbers may have.
    header: int | None  #: Index of the row of names.
    units: int | None  #: Index of the row of units.
    clock: Clock | None  #: Time that rows above the numbers give.


class Shape(NamedTuple):
    """Which columns of rows have numbers."""

    width: int  #: Number of cells that most rows have.
    numeric: tuple[int, ...]  #: Which columns have numbers.
    words: int = 0  #: How many columns have something else; empty ones do not count.


def shape_of(rows: Sequence[Row], is_number: Callable[[str], bool]) -> Shape:
    """Return the shape of most of the rows, those at the end counting more than those above them.

    Args:
        rows: The rows; names and remarks may be above the numbers.
        is_number: Tells whether a cell is a number.
    """
    sample = rows[len(rows) // 2 :]
    sample = sample[:: max(1, len(sample) // _SAMPLED)]
    widths = Counter(len(row) for row in sample if any(map(is_number, row)))
    if not widths:
        return Shape(0, ())
    everywhere = Counter(map(len, rows))
    width = max(widths, key=lambda each: (widths[each], everywhere[each]))
    usual = [row for row in sample if len(row) == width]
    numeric, words = [], 0
    for column in range(width):
        cells = [row[column] for row in usual if row[column].lower() not in EMPTY]
        if cells and 2 * sum(map(is_number, cells)) >= len(cells):
            numeric.append(column)
        elif cells:
            words += 1
    return Shape(width, tuple(numeric), words)


def layout_of(rows: Sequence[Row], shape: Shape, is_number: Callable[[str], bool]) -> Layout:
    """Return the layout of the first rows of a file.

    Args:
        rows: The rows.
        shape: Their shape, with at least one column of numbers.
        is_number: Tells whether a cell is a number.
    """
    first = _first_row(rows, shape, is_number)
    above = [index for index in range(first) if any(cell.strip(" #%/-") for cell in rows[index])]
    units = _units_row(rows, above, shape)
    header = next((index for index in reversed(above) if index != units), None)
    if header is not None and not _names_all(rows[header], shape):
        header = None
    names = _cells(rows, header, shape.width)
    said = _cells(rows, units, shape.width)
    columns = []
    for number in range(shape.width):
        name = names[number] if header is not None else str(number + 1)
        columns.append(Column(name, said[number] or _unit_above(rows[:first], shape, number)))
    allowed = {shape.width}
    if header is not None and len(rows[header]) > shape.width:
        allowed.add(len(rows[header]))  # LabVIEW names a column of comments that rows do not have
    clock = _counted_clock(rows, header, units) or _clock_above(rows[:first])
    return Layout(first, tuple(columns), shape.numeric, frozenset(allowed), header, units, clock)


def _first_row(rows: Sequence[Row], shape: Shape, is_number: Callable[[str], bool]) -> int:
    """Return the index of the first row of numbers; rows between such rows are damaged ones."""

    def numbers(row: Row) -> int:
        return sum(column < len(row) and is_number(row[column]) for column in shape.numeric)

    def begins(row: Row) -> bool:
        return shape.numeric[0] < len(row) and is_number(row[shape.numeric[0]])

    def are_names(row: Row) -> bool:
        return _names_all(row, shape) and not numbers(row)

    def is_data(index: int) -> bool:
        row = rows[index]
        cells = [row[column] for column in shape.numeric if column < len(row)]
        fit = all(is_number(cell) or cell.lower() in EMPTY for cell in cells)
        return fit and len(cells) == len(shape.numeric) and numbers(row) > 0

    first = len(rows) - 1
    while first > 0:
        above = first - 1
        if is_data(above) or (above > 0 and is_data(above - 1)):
            first = above
            continue
        damaged = begins(rows[above]) or any(map(are_names, rows[:above]))
        if not (damaged and numbers(rows[above])):
            break  # a row of names such as `x-axis,1,2` is the first of all
        first = above
    return first


def _names_all(row: Row, shape: Shape) -> bool:
    return all(column < len(row) and row[column].strip() for column in shape.numeric)


def _cells(rows: Sequence[Row], index: int | None, width: int) -> list[str]:
    """Return the texts of a row, without the sign of a comment, as many as there are columns."""
    row = [] if index is None else [cell.strip().strip("'").strip() for cell in rows[index]]
    if row:
        row[0] = row[0].lstrip("#%/ ")
    if row and not row[0] and len(row) > width:
        row = row[1:]
    return (row + [""] * width)[:width]


def _units_row(rows: Sequence[Row], above: Sequence[int], shape: Shape) -> int | None:
    """Return the index of a row of units: the last above the numbers, with names above it."""
    if len(above) < 2 or not _names_all(rows[above[-2]], shape):
        return None
    row = rows[above[-1]]
    cells = [row[column] for column in shape.numeric if column < len(row)]
    known = sum(unit_of(cell) is not None for cell in cells)
    return above[-1] if known and 2 * known >= len(cells) else None


def _keyed(rows: Sequence[Row], keys: Sequence[str]) -> Row | None:
    """Return the last row above the numbers that begins with one of these keys, without the key."""
    for row in reversed(rows):
        if row and row[0].strip(" #%:").lower() in keys:
            return row[1:]
    return None


def _unit_above(rows: Sequence[Row], shape: Shape, column: int) -> str:
    """Return the unit of a column that a line of its own says, as scopes and LabVIEW write it."""
    if column not in shape.numeric:
        return ""
    place, with_x = shape.numeric.index(column), _keyed(rows, ("x_columns",))
    if not with_x or with_x[0].lower() != "no":
        if place == 0:
            cells, dimension = _keyed(rows, _UNITS_OF_TIME), _keyed(rows, ("x_dimension",))
            of_time = "s" if dimension and dimension[0].lower() == "time" else ""
            return cells[0] if cells else of_time
        place -= 1
    cells = _keyed(rows, _UNITS_OF_OTHERS) or ()
    return cells[place] if place < len(cells) else ""


def _clock_above(rows: Sequence[Row]) -> Clock | None:
    interval, start = _keyed(rows, _INTERVALS), _keyed(rows, _STARTS)
    if not interval or (step_s := _number(interval[0])) is None or step_s <= 0.0:
        return None
    start_s = _number(start[0]) if start else None
    return Clock(start_s or 0.0, step_s, f"the lines above the samples say every {step_s:g} s")


def _counted_clock(rows: Sequence[Row], header: int | None, units: int | None) -> Clock | None:
    """Return the time of a file of Rigol, whose first column counts samples."""
    if header is None or units is None:
        return None
    names = [cell.strip().lower() for cell in rows[header]]
    if not {"start", "increment"} <= set(names):
        return None
    row = rows[units]
    start_s, step_s = (_number(row[names.index(name)]) for name in ("start", "increment"))
    if start_s is None or not step_s or step_s < 0.0:
        return None
    return Clock(start_s, step_s, f"Start and Increment say from {start_s:g} s every {step_s:g} s")


def _number(text: str) -> float | None:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return None
