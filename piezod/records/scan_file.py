"""A scan in a growing HDF5 file, in the layout of NeXus, sweep by sweep.

::

    /                    NXroot   @default @creator @creator_version
      scan/              NXentry  @default=picture
        title, start_time, configuration
        picture/         NXdata   @signal @axes: the grid, for viewers
          <signal>, <signal>_backward, …   one row for each line; NaN where nothing was swept yet
          <axis>_um      centres of the pixels
        pixels/          NXdata   @signal @axes=first_ns: the same at full precision, in time order
          row, column, position_<axis>_um, <input>, dwell_s, first_ns, last_ns, late_ns
        edges/           NXdata   of a scan that waits for edges: edge_ns, place, used

The file is in HDF5's SWMR mode, and written to the disk after each sweep. It can be read while it
is written, and after the writer was killed up to the last sweep.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, Self

import h5py
import numpy as np
from numpy.typing import NDArray

import piezod
from piezod.errors import DataError
from piezod.reading.hdf5_magic import is_hdf5
from piezod.reading.opened import damage_is_an_error, open_recording
from piezod.records.frozen import FloatArray
from piezod.records.nexus import (
    CHUNK_CACHE_BYTES,
    grow,
    growing_column,
    new_column,
    new_data,
    new_entry,
)
from piezod.records.recording.reserved import Reserved

ENTRY: Final = "scan"
BACKWARD: Final = "_backward"
"""Behind the name of a signal: the sweeps that go back, of lines that are swept both ways."""
ERROR: Final = "error_um"
"""The picture of a scan without an input beside: command minus position."""
_SPARE_BYTES: Final = 1024 * 1024
_LEAST_CHUNK: Final = 64
_MOST_VALUES: Final = 200_000_000


class ScanHeader(NamedTuple):
    """What a file says about its scan."""

    title: str  #: Title, for people.
    start_time: str  #: Time of day at the start, ISO 8601.
    axes: tuple[str, ...]  #: Names of the axes, the fastest first.
    inputs: tuple[str, ...]  #: Names of the inputs beside.
    both_ways: bool  #: Whether each line is swept forward and backward.
    configuration: str = ""  #: Text of the description.
    by_loop: bool = False  #: Whether the loop scans: its cycles may be late.
    edges: bool = False  #: Whether it waits for edges.
    #: Unit of axes in another unit than µm, as in `{"rx": "urad"}`.
    units: Mapping[str, str] = {}

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the pictures: the inputs beside, or the error of the position."""
        return self.inputs or (ERROR,)


class SweptPixels(NamedTuple):
    """The pixels of one sweep, in the order of time."""

    row: int  #: Row of the picture.
    backward: bool  #: Whether the sweep goes backward.
    position_um: FloatArray  #: (pixels, axes) measured displacement, in µm.
    error_um: FloatArray  #: (pixels,) command minus position of the fastest axis, in µm.
    inputs: FloatArray  #: (pixels, inputs) values of the inputs beside.
    dwell_s: float  #: Time of a pixel, in s.
    first_ns: NDArray[np.int64]  #: (pixels,) first sample of each pixel since the first sweep.
    last_ns: NDArray[np.int64]  #: (pixels,) its last sample.
    late_ns: NDArray[np.int64] | None = None  #: (pixels,) largest lateness of its cycles, if known.


class ScanFile:
    """Writes a scan to a new file. Every call may block on the disk; memory does not grow.

    Args:
        path: Path of the file; it must not exist, but its folder must.
        header: What it says about the scan.
        centres_um: Centres of the pixels along each axis, the fastest first, in µm. A stack has its
            only axis across the rows: its pixels are rows.
        rows: Number of rows of the picture.
        columns: Number of pixels of a sweep.

    Raises:
        OSError: If the file exists already or cannot be made.
    """

    def __init__(
        self,
        path: Path,
        header: ScanHeader,
        centres_um: Sequence[FloatArray],
        rows: int,
        columns: int,
    ) -> None:
        self._header, self._columns = header, columns
        self._reserved = Reserved(path)
        try:
            self._reserved.reserve(_SPARE_BYTES)
            cache = CHUNK_CACHE_BYTES
            self._file = h5py.File(path, "w", libver="v110", track_order=True, rdcc_nbytes=cache)
            self._reserved.reserve(_SPARE_BYTES)  # again, because h5py has truncated the file
            self._make(centres_um, rows)
            self._file.swmr_mode = True  # after all datasets: this mode cannot create any
        except BaseException:
            self._reserved.release()
            path.unlink()
            raise

    def _make(self, centres_um: Sequence[FloatArray], rows: int) -> None:
        header, columns = self._header, self._columns
        creator = {"creator": "piezod", "creator_version": piezod.__version__}
        entry = new_entry(self._file, ENTRY, **creator)
        entry.attrs["default"] = "picture"
        entry["title"], entry["start_time"] = header.title, header.start_time
        entry["configuration"] = header.configuration
        first, *further = (
            name + way for name in header.signals for way in ("", BACKWARD)[: 1 + header.both_ways]
        )
        picture = new_data(entry, "picture", first)
        if further:
            picture.attrs["auxiliary_signals"] = further
        flat = columns == 1
        for name in (first, *further):
            shape, chunk = ((rows,), (rows,)) if flat else ((rows, columns), (1, columns))
            data = picture.create_dataset(name, shape, np.float64, chunks=chunk, fillvalue=np.nan)
            data.attrs["units"] = "um" if name.startswith(ERROR) else ""
        self._pictures = {name: picture[name] for name in (first, *further)}
        self._make_scales(picture, centres_um, rows, flat=flat)
        self._make_lists(entry, columns)
        for axis, unit in header.units.items():
            of_axis = [picture[f"{axis}_um"], self._lists[f"position_{axis}_um"]]
            if axis == header.axes[0] and not header.inputs:  # its errors are the picture
                of_axis += [*self._pictures.values(), self._lists[ERROR]]
            for column in of_axis:
                column.attrs["units"] = unit
        if header.edges:
            edges = new_data(entry, "edges", "place", "edge_ns")
            self._edges = {
                name: growing_column(edges, name, np.int64, _LEAST_CHUNK, about=about)
                for name, about in (
                    ("edge_ns", "Time of the edge by the clock of the device, since its start."),
                    (
                        "place",
                        "Edges used before it; in a stack the row of the present plane.",
                    ),
                    (
                        "used",
                        "1 if the scan waited for it, 0 if it moved nothing.",
                    ),
                )
            }

    def _make_scales(
        self, picture: h5py.Group, centres_um: Sequence[FloatArray], rows: int, *, flat: bool
    ) -> None:
        names = [f"{axis}_um" for axis in self._header.axes]
        scales = dict(zip(names, centres_um, strict=True))
        order = names[::-1]
        if not flat and len(names) == 1:
            scales["line"] = np.arange(rows, dtype=np.float64)
            order = ["line", *names]
        for name, values in scales.items():
            new_column(picture, name, values, f"centres of the pixels, {name}")
        picture.attrs["axes"] = order

    def _make_lists(self, entry: h5py.Group, columns: int) -> None:
        chunk = max(columns, _LEAST_CHUNK)
        lists = new_data(entry, "pixels", self._header.signals[0], "first_ns")
        late = (
            ("late_ns", np.int64, "Largest lateness of its cycles: wake-up after the instant."),
        )
        self._lists = {
            name: growing_column(lists, name, dtype, chunk, about=about)
            for name, dtype, about in (
                ("row", np.int32, "Row of the picture."),
                ("column", np.int32, "Column of the picture."),
                *(
                    (f"position_{axis}_um", np.float64, f"Mean measured position of axis {axis}.")
                    for axis in self._header.axes
                ),
                *((name, np.float64, "Mean of the samples.") for name in self._header.signals),
                ("dwell_s", np.float64, "Time of the pixel."),
                ("first_ns", np.int64, "Time of its first sample since the first sweep."),
                ("last_ns", np.int64, "Time of its last sample."),
                *(late if self._header.by_loop else ()),
            )
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def append(self, pixels: SweptPixels) -> None:
        """Add a sweep, and write it to the disk.

        Raises:
            OSError: If the disk refuses it.
        """
        n = self._columns
        self._reserved.reserve(self._file.id.get_filesize() + _SPARE_BYTES + 256 * n)
        order = np.arange(n)[::-1] if pixels.backward else np.arange(n)
        inputs = pixels.inputs if self._header.inputs else pixels.error_um[:, None]
        way = BACKWARD if self._header.both_ways and pixels.backward else ""
        columns = {
            "row": np.full(n, pixels.row),
            "column": order,
            "dwell_s": np.full(n, pixels.dwell_s),
            "first_ns": pixels.first_ns,
            "last_ns": pixels.last_ns,
        }
        if pixels.late_ns is not None:
            columns["late_ns"] = pixels.late_ns
        for i, axis in enumerate(self._header.axes):
            columns[f"position_{axis}_um"] = pixels.position_um[:, i]
        for i, name in enumerate(self._header.signals):
            columns[name] = inputs[:, i]
            self._pictures[name + way][pixels.row] = inputs[order, i] if n > 1 else inputs[0, i]
        try:
            for name, values in columns.items():
                grow(self._lists[name], np.asarray(values))
            self._file.flush()
        except RuntimeError as error:  # h5py raises this for some disk errors
            raise OSError(f"{self._file.filename}: {error}") from error

    def add_edges(self, edge_ns: Sequence[int], place: Sequence[int], used: Sequence[bool]) -> None:
        """Add edges: their time in ns, the row of the present plane, whether the scan used them."""
        for name, values in (("edge_ns", edge_ns), ("place", place), ("used", used)):
            grow(self._edges[name], np.array(values, np.int64))

    def close(self) -> None:
        """Close the file; a second call does nothing.

        Raises:
            OSError: If the disk refuses it.
        """
        if self._file:
            try:
                self._file.close()
            finally:
                self._reserved.release()


@dataclass(frozen=True, eq=False)
class StoredScan:
    """The pictures of a scan file."""

    title: str  #: Title of the scan.
    pictures: dict[str, FloatArray]  #: Each picture by its name, rows first; NaN where it is empty.
    scales: tuple[tuple[str, FloatArray], ...]  #: Name and values of each scale, rows first.
    units: dict[str, str]  #: Unit of each scale; empty for numbers without one.


def is_scan(path: Path) -> bool:
    """Return whether a file is one of a scan.

    Raises:
        DataError: If it is no regular file, or damaged.
        OSError: If it cannot be read.
    """
    if not is_hdf5(path):
        return False
    with damage_is_an_error(path), open_recording(path) as file:
        return ENTRY in file and "picture" in file[ENTRY]


def read_scan(path: Path) -> StoredScan:
    """Return the pictures of a scan file, also of one that is being written.

    Raises:
        DataError: If it is no such file, or damaged.
        OSError: If it cannot be read.
    """
    with damage_is_an_error(path), open_recording(path) as file:
        entry = file[ENTRY]
        picture = entry["picture"]
        names = [str(picture.attrs["signal"])]
        names += [str(name) for name in picture.attrs.get("auxiliary_signals", ())]
        scales = tuple(str(name) for name in picture.attrs["axes"])
        for name in (*names, *scales):
            if picture[name].size > _MOST_VALUES or picture[name].dtype.kind != "f":
                raise DataError(f"{path}: {name} is no picture of a scan")
        return StoredScan(
            str(entry["title"][()].decode()),
            {name: picture[name][()] for name in names},
            tuple((name, picture[name][()]) for name in scales),
            {name: str(picture[name].attrs.get("units", "")) for name in scales},
        )
