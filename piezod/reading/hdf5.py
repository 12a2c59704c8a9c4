"""Tables in HDF5 files of any program, those of MATLAB from version 7.3 among them."""

from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from piezod.errors import DataError
from piezod.reading.arrays import table_of_arrays
from piezod.reading.hdf5_structure import usable_datasets
from piezod.reading.opened import damage_is_an_error, open_recording
from piezod.reading.table import Table

_UNITS: Final = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_HIDDEN: Final = "/#"
"""Beginning of what MATLAB keeps for itself."""


class _Dataset:
    """A dataset, or a field of one, that is read when it is needed."""

    def __init__(self, file: Path, dataset: h5py.Dataset, field: str | None = None) -> None:
        self._file, self._place, self._field = file, dataset.name, field
        self.dtype = dataset.dtype[field] if field else dataset.dtype
        self.shape, self.size = dataset.shape, int(dataset.size)

    def __getitem__(self, _: tuple[()]) -> Any:
        with damage_is_an_error(self._file), h5py.File(self._file, "r") as opened:
            dataset = opened[self._place]
            return dataset[self._field] if self._field else dataset[()]


def open_hdf5(file: Path, part: str) -> Table:
    """Return the table in an HDF5 file.

    Args:
        file: The file.
        part: Path of a group or dataset in it, as in "/scan/axis"; empty for all.

    Raises:
        DataError: If it has no arrays of numbers that can be read, or is damaged.
    """
    arrays: dict[str, Any] = {}
    units: dict[str, str] = {}
    with open_recording(file, foreign=True) as opened, damage_is_an_error(file):
        if part and part not in opened:
            raise DataError(f"{file}: there is no {part} in it; it has: {', '.join(opened)}")
        usable, reason = usable_datasets(opened)
        for place, dataset in usable.items():
            if place.startswith(_HIDDEN) or dataset.attrs.get("MATLAB_class") == b"char":
                continue
            name = place.strip("/")
            arrays[name] = _Dataset(file, dataset)
            units[name] = _unit(dataset)
    if not arrays and reason:
        raise DataError(f"{file}: {reason}")
    return table_of_arrays(file, part, "HDF5", arrays, units)


def _unit(dataset: h5py.Dataset) -> str:
    found = next((dataset.attrs[name] for name in _UNITS if name in dataset.attrs), "")
    if isinstance(found, np.ndarray) and found.size == 1:
        found = found.reshape(-1)[0]
    return found.decode(errors="replace") if isinstance(found, bytes) else str(found)
