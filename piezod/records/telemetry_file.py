"""Every cycle of a running stage in an HDF5 file that grows, laid out after NeXus.

::

    /                          NXroot   @default
      recording/               NXentry  @default @rate_hz @start_ns @lost @axes
        title, start_time
        gaps                   rows of (index of the first record after it, records lost)
        NAME/data              NXnote, one for each text that belongs to the recording
        cycles/                NXdata   @signal=late_ns @axes=t_s
          t_s, seq, t_ns, state, …
        axis_<axis>/           NXdata   @signal=position_um @axes=t_s @axis
          t_s, drive_v, position_um, command_um, …

The file is in HDF5's SWMR mode: it can be read while it is written, and up to the last second or so
after the writer was killed or the disk was full. Viewers then want that mode too, in Python
`h5py.File(path, swmr=True)`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.records.reserved import Reserved
from piezod.units import NS_PER_S

_ENTRY: Final = "recording"
_UNITS: Final = {"ns": "ns", "um": "um", "v": "V", "s": "s"}
_CHUNK_RANGE: Final = (10, 8192)
"""Records that are written at once; about a second's, so that this is what a crash costs."""
_SPARE_BYTES: Final = 64 * 1024
"""Room for what HDF5 keeps beside the values of a column."""


@dataclass(frozen=True)
class TelemetryHeader:
    """What is said of a recording as a whole.

    Attributes:
        title: What it is, for people.
        axes: Names of the axes, in the order of the records.
        rate_hz: Cycles per second, above 0.
        started_at: Time of day of `start_ns`, ISO 8601 with the offset from UTC.
        start_ns: Instant that is 0 s in the file, on the clock of the records.
        names: Names of the numbers of a field, as in `{"state": ("BOOT", "SAFE")}`.
        notes: Texts that belong to it by name, as in `{"configuration": "rate_hz: 1000"}`.
    """

    title: str
    axes: tuple[str, ...]
    rate_hz: float
    started_at: str
    start_ns: int
    names: Mapping[str, Sequence[str]] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)


class TelemetryWriter:
    """Writes records to a new file, in portions of about a second.

    For one thread at a time; every call may block on the disk. After an error of `append` the file
    ends with what was written before; `close` it.

    Args:
        path: The file; it must not exist, its folder must.
        header: What is said of it.
        dtype: Description of a record: fields of the cycle, and `axes`, an array with the fields
            of each axis. Fields that begin with an underscore are left out.

    Raises:
        OSError: If the file exists already or cannot be made.
    """

    def __init__(self, path: Path, header: TelemetryHeader, dtype: np.dtype[np.void]) -> None:
        self._header = header
        self._chunk = int(np.clip(round(header.rate_hz), *_CHUNK_RANGE))
        self._pending = np.empty(0, dtype)
        self._gaps: list[tuple[int, int]] = []
        self.records = 0
        """Records that `append` took."""
        self.lost = 0
        """Records that were lost before or between them."""
        names = len(dtype.names or ()) + len(header.axes) * len(dtype["axes"].base.names or ())
        self._spare_bytes = names * _SPARE_BYTES + sum(map(len, header.notes.values())) * 4
        self._reserved = Reserved(path)
        try:
            self._reserved.reserve(self._spare_bytes)
            self._file = h5py.File(path, "w", libver="v110", track_order=True)
            self._reserved.reserve(self._spare_bytes)  # again: what was there is gone
            self._columns = self._lay_out(dtype)
            self._file.swmr_mode = True
        except BaseException:
            self._reserved.release()
            path.unlink()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def append(self, records: NDArray[Any], lost: int = 0) -> None:
        """Add records.

        Args:
            records: Shape (n,), of the description given to the constructor; copied.
            lost: How many were lost before them.

        Raises:
            OSError: If the disk does not take them.
        """
        if lost:
            self._gaps.append((self.records, lost))
            self.lost += lost
        self.records += len(records)
        self._pending = np.concatenate((self._pending, records))
        whole = len(self._pending) // self._chunk * self._chunk
        if whole:
            self._write(whole)

    def close(self) -> None:
        """Write what is left and close the file; a second time this does nothing.

        Raises:
            OSError: If the disk does not take it; the file is closed nevertheless.
        """
        if not self._file:
            return
        try:
            self._write(len(self._pending))
        finally:
            self._file.close()
            self._reserved.release()

    def _write(self, count: int) -> None:
        portion, rest = self._pending[:count], self._pending[count:].copy()
        gaps, self._gaps = self._gaps, []
        self._pending = self._pending[:0]  # where it fails, nothing more is to be written
        size = self._file.id.get_filesize() + 2 * portion.nbytes + self._spare_bytes
        self._reserved.reserve(size)
        for dataset, values in self._columns_of(portion):
            _grow(dataset, values)
        _grow(self._gaps_dataset, np.array(gaps, "i8").reshape(-1, 2))
        self._entry.attrs.modify("lost", np.int64(self.lost))
        self._file.flush()
        self._pending = rest

    def _columns_of(self, portion: NDArray[Any]) -> Iterator[tuple[h5py.Dataset, NDArray[Any]]]:
        for (axis, name), dataset in self._columns.items():
            yield dataset, portion[name] if axis < 0 else portion["axes"][:, axis][name]
        # Time comes last: what has a time has everything.
        yield self._t_s, (portion["t_ns"] - self._header.start_ns) / NS_PER_S

    def _lay_out(self, dtype: np.dtype[np.void]) -> dict[tuple[int, str], h5py.Dataset]:
        header = self._header
        self._file.attrs["NX_class"] = "NXroot"
        self._file.attrs["default"] = _ENTRY
        self._entry = entry = _group(self._file, _ENTRY, "NXentry")
        entry["title"], entry["start_time"] = header.title, header.started_at
        entry.attrs["rate_hz"], entry.attrs["start_ns"] = header.rate_hz, header.start_ns
        entry.attrs["axes"], entry.attrs["lost"] = list(header.axes), np.int64(0)
        entry.attrs["default"] = f"axis_{header.axes[0]}"
        self._gaps_dataset = entry.create_dataset(
            "gaps", (0, 2), "i8", maxshape=(None, 2), chunks=(64, 2)
        )
        for name, text in header.notes.items():
            _group(entry, name, "NXnote")["data"] = text
        cycles = self._data_group("cycles", "late_ns")
        self._t_s = self._dataset(cycles, "t_s", np.dtype("f8"))
        columns = {
            (-1, name): self._dataset(cycles, name, dtype[name])
            for name in _shown(dtype)
            if name not in ("axes", "end_seq")
        }
        for index, axis in enumerate(header.axes):
            group = self._data_group(f"axis_{axis}", "position_um")
            group.attrs["axis"] = axis
            group.attrs["auxiliary_signals"] = ["command_um", "drive_v"]
            group["t_s"] = self._t_s
            fields = dtype["axes"].base
            columns |= {
                (index, name): self._dataset(group, name, fields[name]) for name in _shown(fields)
            }
        return columns

    def _data_group(self, name: str, signal: str) -> h5py.Group:
        group = _group(self._entry, name, "NXdata")
        group.attrs["signal"], group.attrs["axes"] = signal, "t_s"
        return group

    def _dataset(self, group: h5py.Group, name: str, dtype: np.dtype[Any]) -> h5py.Dataset:
        if name in self._header.names:
            numbers = {text: number for number, text in enumerate(self._header.names[name])}
            dtype = h5py.enum_dtype(numbers, basetype=dtype)
        dataset = group.create_dataset(
            name,
            (0,),
            dtype,
            maxshape=(None,),
            chunks=(self._chunk,),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
        dataset.attrs["units"] = _UNITS.get(name.rsplit("_", 1)[-1], "")
        return dataset


def _grow(dataset: h5py.Dataset, values: NDArray[Any]) -> None:
    before = len(dataset)
    dataset.resize(before + len(values), axis=0)
    dataset[before:] = values


def _shown(dtype: np.dtype[np.void]) -> list[str]:
    return [name for name in dtype.names or () if not name.startswith("_")]


def _group(parent: h5py.Group, name: str, nexus_class: str) -> h5py.Group:
    group = parent.create_group(name, track_order=True)
    group.attrs["NX_class"] = nexus_class
    return group
