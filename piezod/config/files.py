"""Other files that a configuration refers to."""

import hashlib
import math
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from pydantic import BeforeValidator, ValidationInfo

from piezod.config.fields import Context, Quantity, broken_rule, context_of
from piezod.config.messages import show
from piezod.errors import DataError
from piezod.service_view import service_hint

# Points closer than this count as one instant with two values: no line joins them.
MIN_STEP_S: Final = 1e-6
MAX_POINTS: Final = 1_000_000
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
    """Return the points of a waveform from a table in any known format.

    Args:
        path: Path of the file.
        column: Name of the column with the values, in V or µm if no unit is known; the time is
            the column that has a name and a unit of it, as `t_s`.

    Returns:
        At least one pair of time in s and value, with increasing times.

    Raises:
        ValueError: If the file breaks a rule; the text names the file and the line.
    """
    from piezod.reading.record import read_series  # noqa: PLC0415 - imports numpy, which is slow

    try:
        series = read_series(path, column)
    except DataError as error:
        raise ValueError(str(error)) from error
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    points = tuple(
        zip(series.columns["t_s"].tolist(), series.columns[column].tolist(), strict=True)
    )
    if len(points) > MAX_POINTS:
        place = series.place(MAX_POINTS)
        raise ValueError(f"{place}: too many points, allowed: at most {MAX_POINTS}")
    before_s = -math.inf
    for index, (t_s, value) in enumerate(points):
        if not abs(value) <= MAX_VALUE:  # refuses NaN too
            what = f"must be a number (got {value:g}), {Quantity(-MAX_VALUE, MAX_VALUE)}"
            raise ValueError(f"{series.place(index)}: {what}")
        if not t_s - before_s >= MIN_STEP_S:
            what = f"time must grow by at least {MIN_STEP_S:g} s (got {t_s:g})"
            raise ValueError(f"{series.place(index)}: {what}")
        before_s = t_s
    return points
