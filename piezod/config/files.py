"""Other files that a configuration refers to."""

import csv
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from pydantic import BeforeValidator, ValidationInfo

from piezod.config.fields import Quantity, broken_rule, context_of
from piezod.config.messages import show, suggest

TIME_COLUMN: Final = "t_s"
# Points closer than this are one instant with two values: no line can be drawn through them.
MIN_STEP_S: Final = 1e-6
MAX_POINTS: Final = 1_000_000
MAX_VALUE: Final = 1e6

Point: TypeAlias = tuple[float, float]


def _existing_file(value: object, info: ValidationInfo) -> object:
    if isinstance(value, Path):
        return value
    if not isinstance(value, str):
        raise broken_rule(f"must be the path of a file (got {show(value)})")
    folder = context_of(info).folder
    try:
        exists = (folder / value).is_file()
    except (OSError, ValueError):
        exists = False
    if not exists:
        raise broken_rule(f"no such file in {folder.absolute()} (got {show(value)})")
    return folder / value


ExistingFile: TypeAlias = Annotated[Path, BeforeValidator(_existing_file)]


def read_points(path: Path, column: str) -> tuple[Point, ...]:
    """Read the points of a waveform from a CSV file with a header.

    Args:
        path: The file.
        column: Name of the column with the values; the times are in the column `t_s`.

    Returns:
        At least one pair of time in s and value, the times increasing.

    Raises:
        ValueError: If that is not possible; the text names the file and the line.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            points = _points(csv.reader(stream), column)
    except (OSError, UnicodeError, csv.Error) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path}:{error}") from error
    return points


def _points(rows: Iterable[list[str]], column: str) -> tuple[Point, ...]:
    numbered = ((line, row) for line, row in enumerate(rows, start=1) if row)
    _, header = next(numbered, (1, []))
    names = [name.strip() for name in header]
    for name in (TIME_COLUMN, column):
        if name not in names:
            raise ValueError(f"1: no column {name!r}, {suggest(name, names, 'columns')}")
    t_index, value_index = names.index(TIME_COLUMN), names.index(column)
    points: list[Point] = []
    for line, row in numbered:
        point = (_number(row, t_index, line), _number(row, value_index, line))
        if points and point[0] - points[-1][0] < MIN_STEP_S:
            raise ValueError(
                f"{line}: time must grow by at least {MIN_STEP_S:g} s (got {row[t_index]!r})"
            )
        points.append(point)
        if len(points) > MAX_POINTS:
            raise ValueError(f"{line}: too many points, allowed: at most {MAX_POINTS}")
    if not points:
        raise ValueError("2: no points")
    return tuple(points)


def _number(row: list[str], index: int, line: int) -> float:
    text = row[index] if index < len(row) else ""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) <= MAX_VALUE:
        what = f"must be a number (got {text!r}), {Quantity(-MAX_VALUE, MAX_VALUE)}"
        raise ValueError(f"{line}: {what}")
    return number
