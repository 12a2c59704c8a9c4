"""What the parts of a recording of a stage must be, checked before they are read."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, Final, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.errors import DataError
from piezod.reading.opened import MOST_READ_BYTES
from piezod.records.nexus import axis_names
from piezod.records.recording.columns import ENTRY, FORMS

_MOST_RATE_HZ: Final = 1e7
_LATEST_S: Final = 1e9
_MOST_AXES: Final = 64
_MOST_WEIGHTS: Final = 8192
_NUMBERS: Final = "biuf"

Value = TypeVar("Value")


class Named(dict[str, Value]):
    """Parts of a recording by name, of which a file may have less than a command needs.

    Args:
        kind: What they are, as in "column of axis x".
        parts: The parts.
    """

    def __init__(self, kind: str, parts: Mapping[str, Value]) -> None:
        super().__init__(parts)
        self._kind = kind

    def __missing__(self, name: str) -> Value:
        """Refuse a part that is not there.

        Raises:
            DataError: Always.
        """
        found = ", ".join(self) or "none"
        raise DataError(
            f"the recording has no {self._kind} {name!r}; it has: {found}; record again with this "
            "version of piezod"
        )


def stage_entry(file: h5py.File) -> h5py.Group:
    """Return the entry of the recording of a stage, whose parts are as `writer` says.

    Raises:
        DataError: If the file is another one, or a part is wrong.
        KeyError: If a part is missing.
    """
    if not all(f"{ENTRY}/{part}" in file for part in ("cycles/t_s", "gaps")):
        raise DataError(
            "this is not the recording of a stage, which `piezod record` makes. Open other files, "
            "as those of experiments, with an HDF5 viewer"
        )
    _check_layout(file[ENTRY])
    return file[ENTRY]


def _check_layout(entry: h5py.Group) -> None:
    attributes = entry.attrs
    _check_number("rate_hz", attributes["rate_hz"], 1e-6, _MOST_RATE_HZ)
    _check_number("start_ns", attributes["start_ns"], -(2**62), 2**62)
    _check_number("lost", attributes["lost"], 0, 2**62)
    _check_number("part", attributes.get("part", 1), 1, 1e9)
    axes = axis_names(entry)
    if not 0 < len(axes) <= _MOST_AXES or len(set(axes)) < len(axes):
        raise _wrong("axis_names", f"{len(axes)} names", f"1 to {_MOST_AXES} different ones")
    for name in ("title", "start_time"):
        if entry[name].shape != () or h5py.check_string_dtype(entry[name].dtype) is None:
            raise _wrong(name, f"data of shape {entry[name].shape}", "one text")
    for name in ("cycles", *(f"axis_{axis}" for axis in axes)):
        _check_columns(name, entry[name])
    if entry["cycles/t_s"].dtype.kind != "f":
        raise _wrong("cycles/t_s", f"the type {entry['cycles/t_s'].dtype}", "float")
    _check_table("gaps", entry["gaps"], "iu", 2, 2)
    for axis in axes:
        if (group := entry.get(f"weights_{axis}")) is not None:
            _check_weights(f"weights_{axis}", group)


def check_time(t_s: NDArray[Any]) -> None:
    """Check the instants of the cycles.

    Args:
        t_s: Instants, in s, shape (n,).

    Raises:
        DataError: If one is not finite, or they do not rise.
    """
    bad = ~(np.abs(t_s) <= _LATEST_S)  # finds NaN, too
    bad[1:] |= np.diff(t_s) < 0.0
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise _wrong("cycles/t_s", f"{t_s[row]} in row {row}", "time that rises, in s")


def check_numbers(name: str, values: NDArray[Any], names: int) -> None:
    """Check numbers that stand for names.

    Args:
        name: Name of the column.
        values: The numbers, shape (n,).
        names: How many names there are.

    Raises:
        DataError: If a number has no name.
    """
    if values.size and (values.min() < 0 or values.max() >= names):
        row = int(np.flatnonzero((values < 0) | (values >= names))[0])
        raise _wrong(name, f"{values[row]} in row {row}", f"0 to {names - 1}, which have names")


def check_room(datasets: Iterable[h5py.Dataset], rows: int) -> None:
    """Check that rows of datasets fit into memory.

    Raises:
        DataError: If they do not.
    """
    row_bytes = sum(each.dtype.itemsize * int(np.prod(each.shape[1:])) for each in datasets)
    if (size_bytes := rows * row_bytes) > MOST_READ_BYTES:
        raise DataError(
            f"{rows} rows need {size_bytes / 1e9:.1f} GB; allowed: {MOST_READ_BYTES / 1e9:.0f} GB "
            "at once; choose a part with --begin-s and --end-s, or `piezod export` it"
        )


def _check_columns(name: str, group: h5py.Group) -> None:
    if not isinstance(group, h5py.Group) or not len(group):
        raise _wrong(name, "no columns", "a group of columns")
    for column, dataset in group.items():
        place = f"{name}/{column}"
        if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1:
            raise _wrong(place, f"the shape {getattr(dataset, 'shape', None)}", "one dimension")
        if dataset.dtype.kind not in ("iu" if "bits" in dataset.attrs else _NUMBERS):
            raise _wrong(place, f"the type {dataset.dtype}", "numbers, whole ones for bits")


def _check_weights(name: str, group: h5py.Group) -> None:
    weights = group["weights"]
    _check_table(f"{name}/weights", weights, "f", 1, _MOST_WEIGHTS)
    if weights.chunks is None:
        raise _wrong(f"{name}/weights", "no chunks", "chunks of rows")
    for column in ("weights_t_s", "weights_form"):
        if (dataset := group.get(column)) is not None and dataset.ndim != 1:
            raise _wrong(f"{name}/{column}", f"the shape {dataset.shape}", "one dimension")
    if (forms := group.get("weights_form")) is not None:
        check_room([forms], len(forms))
        check_numbers(f"{name}/weights_form", forms[()], len(FORMS))


def _check_table(place: str, dataset: h5py.Dataset, kinds: str, least: int, most: int) -> None:
    shape: tuple[int, ...] = getattr(dataset, "shape", None) or ()
    if len(shape) != 2 or not least <= shape[-1] <= most or dataset.dtype.kind not in kinds:
        raise _wrong(place, f"the shape {shape}", f"rows of {least} to {most} numbers")


def _check_number(name: str, value: Any, least: float, most: float) -> None:
    if np.ndim(value) or not isinstance(value, np.integer | np.floating | int | float):
        raise _wrong(name, f"{str(value)[:40]!r}", "a number")
    if not (isfinite(value) and least <= value <= most):
        raise _wrong(name, str(value), f"{least:g} to {most:g}")


def _wrong(place: str, found: str, allowed: str) -> DataError:
    return DataError(
        f"it is damaged, or another program wrote it: {place} has {found}; allowed: {allowed}; "
        "take another copy of it, or record again"
    )
