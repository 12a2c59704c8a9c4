"""Other files that a configuration refers to."""

import hashlib
import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from pydantic import BeforeValidator, ValidationInfo

from piezod.config.fields import Context, Quantity, broken_rule, context_of
from piezod.config.messages import show, suggest
from piezod.config.scalars import NUMBER
from piezod.errors import DataError
from piezod.given_file import open_given
from piezod.service_view import service_hint

TIME_COLUMN: Final = "t_s"
# Points closer than this count as one instant with two values: no line joins them.
MIN_STEP_S: Final = 1e-6
MAX_POINTS: Final = 1_000_000
MAX_POINTS_BYTES: Final = 256_000_000
MAX_COLUMNS: Final = 1000
MAX_VALUE: Final = 1e6

Point: TypeAlias = tuple[float, float]


def digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; empty if there is no such file to read."""
    with suppress(OSError):
        if path.is_file():  # anything else might wait for a writer
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
    return ""


def existing_file(value: object, context: Context) -> Path:
    """Return the path of an existing file, and note its digest in the context.

    Args:
        value: Its path; a text is relative to the folder of the context.
        context: The context of the validation.

    Raises:
        PydanticCustomError: If there is no such file.
    """
    folder = context.folder
    if isinstance(value, Path):
        return value
    if not isinstance(value, str):
        raise broken_rule(f"must be the path of a file (got {show(value)})")
    try:
        exists = (folder / value).is_file()
    except (OSError, ValueError):
        exists = False
    if not exists:
        hint = service_hint(folder.absolute() / value)
        raise broken_rule(f"no such file in {folder.absolute()} (got {show(value)}){hint}")
    path = folder / value
    context.named_files[str(path.absolute())] = digest(path)
    return path


def _existing(value: object, info: ValidationInfo) -> Path:
    return existing_file(value, context_of(info))


ExistingFile: TypeAlias = Annotated[Path, BeforeValidator(_existing)]


def read_points(path: Path, column: str) -> tuple[Point, ...]:
    """Return the points of a waveform from a CSV file with a header.

    The format is plain: fields separated by commas, without quotes; numbers with a decimal point;
    as many fields in each row as in the header; empty rows only at the end.

    Args:
        path: Path of the file.
        column: Name of the column with the values; the times are in the column `t_s`.

    Returns:
        At least one pair of time in s and value, with increasing times.

    Raises:
        ValueError: If the file breaks a rule; the text names the file and the line.
    """
    try:
        with TextIOWrapper(open_given(path, MAX_POINTS_BYTES), encoding="utf-8-sig") as stream:
            points = _points(_rows(stream), column)
    except DataError as error:
        raise ValueError(str(error)) from error
    except (OSError, UnicodeError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path}:{error}") from error
    return points


def _rows(lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the fields of each row with its line number, counted as in an editor."""
    first_empty = 0
    for line, text in enumerate(lines, start=1):
        if not text.strip():
            first_empty = first_empty or line
        elif first_empty:
            raise ValueError(f"{first_empty}: the row is empty, delete it")
        else:
            yield line, [field.strip() for field in text.split(",")]


def _points(rows: Iterator[tuple[int, list[str]]], column: str) -> tuple[Point, ...]:
    _, names = next(rows, (1, []))
    if len(names) > MAX_COLUMNS:
        raise ValueError(f"1: too many columns ({len(names)}), allowed: at most {MAX_COLUMNS}")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"1: column {name!r} appears {names.count(name)} times")
    t_index, value_index = (_index(names, name) for name in (TIME_COLUMN, column))
    points: list[Point] = []
    for line, row in rows:
        if len(row) != len(names):
            found = "1 field" if len(row) == 1 else f"{len(row)} fields"
            raise ValueError(f"{line}: {found}, allowed: {len(names)} as in the header")
        point = (_number(row[t_index], line), _number(row[value_index], line))
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


def _index(names: list[str], name: str) -> int:
    if name not in names:
        raise ValueError(f"1: no column {name!r}, {suggest(name, names, 'columns')}")
    return names.index(name)


def _number(text: str, line: int) -> float:
    number = float(text) if NUMBER.fullmatch(text) else math.nan
    if not abs(number) <= MAX_VALUE:  # refuses NaN too
        what = f"must be a number (got {text!r}), {Quantity(-MAX_VALUE, MAX_VALUE)}"
        raise ValueError(f"{line}: {what}")
    return number
