"""The growing datasets of a recording of a running stage."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from piezod.records.telemetry_header import TelemetryHeader
from piezod.units import NS_PER_S

ENTRY: Final = "recording"
_UNITS: Final = {"ns": "ns", "um": "um", "v": "V", "s": "s"}
_SIDE_CHUNK: Final = 64
"""Rows per chunk of data that are rarer than records."""


class TelemetryColumns:
    """Creates the datasets of an empty file and adds rows to them.

    Args:
        file: An empty file.
        header: Header of the recording.
        dtype: Description of a record, see `TelemetryWriter`.
        chunk: Records per chunk.
    """

    def __init__(
        self, file: h5py.File, header: TelemetryHeader, dtype: np.dtype[np.void], chunk: int
    ) -> None:
        self._header, self._chunk = header, chunk
        file.attrs["NX_class"] = "NXroot"
        file.attrs["default"] = ENTRY
        self._entry = _lay_out_entry(file, header)
        self._gaps = _growing(self._entry, "gaps", np.dtype("i8"), _SIDE_CHUNK, 2)
        cycles = self._data_group("cycles", "late_ns")
        self._t_s = _growing(cycles, "t_s", np.dtype("f8"), chunk)
        # Columns by index of their axis and name; the cycle itself has the index -1.
        self._columns = {
            (-1, name): self._column(cycles, name, dtype[name])
            for name in _public_names(dtype)
            if name not in ("axes", "end_seq")  # `end_seq` only protects the shared memory
        }
        self._weights: dict[str, tuple[h5py.Dataset, h5py.Dataset]] = {}
        for index, axis in enumerate(header.axes):
            self._lay_out_axis(index, axis, dtype["axes"].base)

    def write(self, portion: NDArray[Any], gaps: Sequence[tuple[int, int]]) -> None:
        """Add records, and the gaps before or between them."""
        for (axis, name), dataset in self._columns.items():
            _grow(dataset, portion[name] if axis < 0 else portion["axes"][:, axis][name])
        # Time is written last: a reader that sees a time also finds all other columns.
        _grow(self._t_s, self._seconds(portion["t_ns"]))
        _grow(self._gaps, np.array(gaps, "i8").reshape(-1, 2))
        lost = sum(number for _, number in gaps)
        # `modify` writes in place; in SWMR mode no attribute can be created.
        self._entry.attrs.modify("lost", self._entry.attrs["lost"] + lost)

    def write_weights(self, axis: str, t_ns: Sequence[int], weights: Sequence[Any]) -> None:
        """Add rows of weights of an axis, with their instants."""
        rows, times = self._weights[axis]
        _grow(rows, np.array(weights))
        _grow(times, self._seconds(np.array(t_ns)))

    def _seconds(self, t_ns: NDArray[Any]) -> NDArray[np.float64]:
        return np.asarray((t_ns - self._header.start_ns) / NS_PER_S)

    def _lay_out_axis(self, index: int, axis: str, fields: np.dtype[np.void]) -> None:
        group = self._data_group(f"axis_{axis}", "position_um")
        group.attrs["axis"] = axis
        group.attrs["auxiliary_signals"] = ["command_um", "drive_v"]
        group["t_s"] = self._t_s  # a hard link: all axes share the time of the cycles
        for name in _public_names(fields):
            self._columns[index, name] = self._column(group, name, fields[name])
        if width := self._header.weights.get(axis):
            weights = self._data_group(f"weights_{axis}", "weights", "weights_t_s")
            self._weights[axis] = (
                _growing(weights, "weights", np.dtype("f8"), _SIDE_CHUNK, width),
                _growing(weights, "weights_t_s", np.dtype("f8"), _SIDE_CHUNK),
            )

    def _data_group(self, name: str, signal: str, axes: str = "t_s") -> h5py.Group:
        group = _group(self._entry, name, "NXdata")
        group.attrs["signal"], group.attrs["axes"] = signal, axes
        return group

    def _column(self, group: h5py.Group, name: str, dtype: np.dtype[Any]) -> h5py.Dataset:
        if name in self._header.names:
            numbers = {text: number for number, text in enumerate(self._header.names[name])}
            dtype = h5py.enum_dtype(numbers, basetype=dtype)
        return _growing(group, name, dtype, self._chunk)


def _lay_out_entry(file: h5py.File, header: TelemetryHeader) -> h5py.Group:
    entry = _group(file, ENTRY, "NXentry")
    entry["title"], entry["start_time"] = header.title, header.started_at
    entry.attrs["rate_hz"], entry.attrs["start_ns"] = header.rate_hz, header.start_ns
    entry.attrs["axes"], entry.attrs["lost"] = list(header.axes), np.int64(0)
    entry.attrs["default"] = f"axis_{header.axes[0]}"
    for name, text in header.notes.items():
        _group(entry, name, "NXnote")["data"] = text
    return entry


def _growing(
    group: h5py.Group, name: str, dtype: npt.DTypeLike, chunk: int, *row: int
) -> h5py.Dataset:
    dataset = group.create_dataset(
        name,
        (0, *row),
        dtype,
        maxshape=(None, *row),
        chunks=(chunk, *row),
        compression="gzip",
        compression_opts=1,  # the fastest level: the writer must keep up with the loop
        shuffle=True,
    )
    dataset.attrs["units"] = _UNITS.get(name.rsplit("_", 1)[-1], "")
    return dataset


def _grow(dataset: h5py.Dataset, values: NDArray[Any]) -> None:
    before = len(dataset)
    dataset.resize(before + len(values), axis=0)
    dataset[before:] = values


def _public_names(dtype: np.dtype[np.void]) -> Iterator[str]:
    return (name for name in dtype.names or () if not name.startswith("_"))


def _group(parent: h5py.Group, name: str, nexus_class: str) -> h5py.Group:
    group = parent.create_group(name, track_order=True)
    group.attrs["NX_class"] = nexus_class
    return group
