"""Tables in files of named arrays: .npy and .npz of numpy, .mat of MATLAB up to version 7."""

import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezod.errors import DataError
from piezod.reading.table import (
    MOST_VALUES,
    Column,
    FloatArray,
    Table,
    as_column,
    column_of_array,
    columns_of_array,
)

_DAMAGE: Final = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    TypeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What the readers raise on damaged files."""
_NUMBERS: Final = "biuf"
_WHOLE: Final = "array"
"""Name of the only array of a file; it does not show."""


def open_npy(file: Path, part: str) -> Table:
    """Return the table in a .npy file: a structured array, or one with a column for each signal.

    Raises:
        DataError: If it is none, or is damaged.
    """
    array = _undamaged(file, lambda: np.load(file, allow_pickle=False, mmap_mode="r"))
    if array.dtype.names:
        fields = {name: array[name] for name in array.dtype.names}
        return table_of_arrays(file, part, "numpy array with fields", fields)
    return table_of_arrays(file, part, "numpy array", {"": array})


def open_npz(file: Path, part: str) -> Table:
    """Return the table in a .npz file.

    Raises:
        DataError: If it has no arrays of numbers, or is damaged.
    """

    def loaded() -> dict[str, Any]:
        with np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}

    return table_of_arrays(file, part, "numpy arrays", _undamaged(file, loaded))


def open_mat(file: Path, part: str) -> Table:
    """Return the table in a .mat file up to version 7: its variables, and fields of its structs.

    Raises:
        DataError: If it has no arrays of numbers, or is damaged.
    """
    from scipy import io  # noqa: PLC0415 - takes long to import

    listed = _undamaged(file, lambda: io.whosmat(str(file)))
    wanted = [
        name
        for name, shape, _ in listed
        if 0 < np.prod(shape, dtype=float) <= MOST_VALUES and not name.startswith("__")
    ]
    loaded = _undamaged(
        file, lambda: io.loadmat(str(file), variable_names=wanted, simplify_cells=True)
    )
    arrays = dict(_flat({name: loaded[name] for name in wanted if name in loaded}, ""))
    return table_of_arrays(file, part, "MATLAB file up to version 7", arrays)


def table_of_arrays(
    file: Path, part: str, kind: str, arrays: dict[str, Any], units: dict[str, str] | None = None
) -> Table:
    """Return the table of the arrays of a file that are as long as the longest one.

    Args:
        file: The file.
        part: Beginning of the names that count, as in "/data"; empty for all.
        kind: Kind of the file, for people.
        arrays: Arrays by name, or what is read as one when a column is needed.
        units: Units by name, as far as the file says them.

    Raises:
        DataError: If no array is a column of numbers.
    """
    wanted = part.strip("/")
    columns: list[tuple[Column, str, int | None]] = []
    for name, array in arrays.items():
        inside = not wanted or name == wanted or name.startswith((f"{wanted}/", f"{wanted}."))
        if not inside or array.dtype.kind not in _NUMBERS:
            continue
        shown = name.removeprefix(wanted).lstrip("/.") or name.rpartition("/")[2]
        for column, number in columns_of_array(shown, array.shape):
            columns.append((Column(column, (units or {}).get(name, "")), name, number))
    if not columns:
        inside_text = f" in {part}" if part else ""
        found = ", ".join(arrays) or "nothing"
        raise DataError(
            f"{file}: there is no array of numbers{inside_text}, which has one value for each "
            f"sample; found: {found[:300]}; save time, voltage and position as arrays"
        )

    def read(numbers: Sequence[int]) -> list[FloatArray]:
        return [_column(file, arrays, *columns[number]) for number in numbers]

    form = f"{kind}, {part}" if part else kind
    return Table(file, form, tuple(_with_short_names(each[0] for each in columns)), read)


def _column(
    file: Path, arrays: dict[str, Any], column: Column, name: str, number: int | None
) -> FloatArray:
    array = arrays[name]
    if array.size > MOST_VALUES:
        raise DataError(f"{file}: {column.name} has {array.size} values; allowed: {MOST_VALUES}")
    return as_column(column_of_array(array[()], number), f"{file}: {column.name}")


def _with_short_names(columns: Iterable[Column]) -> Iterable[Column]:
    """Yield the columns with the last part of their path as name, where that is only one's."""
    listed = list(columns)
    short = [column.name.rpartition("/")[2] for column in listed]
    for column, name in zip(listed, short, strict=True):
        yield column._replace(name=name if short.count(name) == 1 else column.name, last=name)


def _flat(values: dict[str, Any], above: str) -> Iterable[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{name}.")
        elif isinstance(value, np.ndarray):
            yield f"{above}{name}", value


def _undamaged(file: Path, read: Callable[[], Any]) -> Any:
    try:
        return read()
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno:
            raise
        what = str(error).partition("\n")[0] or type(error).__name__
        raise DataError(f"{file}: it is damaged, or of another kind: {what}") from error
