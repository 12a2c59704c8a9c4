"""Every cycle of a running stage in a growing HDF5 file, in the layout of NeXus.

::

    /                          NXroot   @default @creator @creator_version
      recording/               NXentry  @default @description @rate_hz @start_ns @lost @axes
        title, start_time
        gaps                   rows of (index of the first record after it, records lost)
        NAME/data              NXnote, one for each text of the recording
        cycles/                NXdata   @signal=late_ns @axes=t_s
          t_s, seq, t_ns, state, …
        axis_<axis>/           NXdata   @signal=position_um @axes=t_s @axis
          t_s, drive_v, position_um, command_um, …
        weights_<axis>/        NXdata   @signal=weights @axes=weights_t_s
          weights_t_s, weights, weights_form
        event_log/             NXcollection
          t_s, t_ns, severity, kind, fault, axis, measured, limit, text
        adopted_models/        NXcollection
          t_s, t_ns, axis, text

Each dataset has @units and @description, an enumeration @values, a bit mask @bits; each group of
data has a @description, so that the file explains itself.

The file is in HDF5's SWMR mode. It can be read while it is written, and up to the last second or so
after the writer was killed or the disk was full. Until it is closed, viewers need that mode too, in
Python `h5py.File(path, "r", swmr=True)`. After a kill `repair` closes it.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, Self

import h5py
import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from piezod.records.nexus import CHUNK_CACHE_BYTES
from piezod.records.recording.columns import TelemetryColumns, WeightsRow
from piezod.records.recording.events import MODEL_BYTES, AdoptedModel
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reserved import Reserved
from piezod.telemetry.layout import EVENT_BYTES
from piezod.telemetry.record import StageEvent

_CHUNK_RANGE: Final = (10, 8192)
"""Records per write; about one second of records, which a crash loses at most."""
_FIRST_PARTS: Final = 32
"""The first records are written when there is this part of a chunk."""
_SPARE_BYTES: Final = 64 * 1024
"""Space for the administrative data of HDF5, per column."""
_SIDE_COLUMNS: Final = 2
"""Events and adopted models together need no more of it than two columns of the cycles."""


class TelemetryWriter:
    """Writes records to a new file, in portions of about a second.

    Use it from one thread; every call may block on the disk. After an error of `append` the file
    ends with the records written before; call `close`.

    Args:
        path: Path of the file; it must not exist, but its folder must.
        header: Header of the recording.
        dtype: Description of a record: fields of the cycle, and `axes`, an array with the fields of
            each axis. Fields that begin with an underscore are left out.

    Raises:
        OSError: If the file exists already or cannot be made.
    """

    def __init__(self, path: Path, header: TelemetryHeader, dtype: np.dtype[np.void]) -> None:
        self.records = 0
        """Number of appended records."""
        self.lost = 0
        """Number of records lost before or between them."""
        self._written = 0
        self._chunk = int(np.clip(round(header.rate_hz), *_CHUNK_RANGE))
        self._pending = np.empty(0, dtype)
        self._gaps: list[tuple[int, int]] = []
        self._weights: dict[str, list[WeightsRow]] = {}
        self._newest: dict[str, WeightsRow] = {}
        self._events: list[StageEvent] = []
        self._models: list[AdoptedModel] = []
        self._weighted = header.weights.keys()
        self._spare_bytes = _spare_bytes(header, dtype)
        self._reserved = Reserved(path)
        try:
            self._reserved.reserve(self._spare_bytes)
            cache = CHUNK_CACHE_BYTES
            self._file = h5py.File(path, "w", libver="v110", track_order=True, rdcc_nbytes=cache)
            self._reserved.reserve(self._spare_bytes)  # again, because h5py has truncated the file
            self._columns = TelemetryColumns(self._file, header, dtype, self._chunk)
            self._file.swmr_mode = True  # after all datasets: this mode cannot create any
        except BaseException:
            self._reserved.release()
            path.unlink()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    @property
    def size_bytes(self) -> int:
        """Size of what is written so far, in bytes."""
        return int(self._file.id.get_filesize())

    def append(self, records: NDArray[Any], lost: int = 0) -> None:
        """Add records.

        Args:
            records: Shape (n,), with the dtype of the constructor; copied.
            lost: Number of records lost before them.

        Raises:
            OSError: If the disk refuses them.
        """
        if lost:
            self._gaps.append((self.records, lost))
            self.lost += lost
        self.records += len(records)
        self._pending = np.concatenate((self._pending, records))
        if count := self._due():
            self._write(count)

    def _due(self) -> int:
        """Return how many of the pending records to write now."""
        total = self._written + len(self._pending)
        if total >= self._chunk:
            # Whole chunks only, because HDF5 compresses a chunk again at each write to it.
            return total // self._chunk * self._chunk - self._written
        # The first chunk in a few growing parts, so that a recording is never empty after a kill.
        early = max(2 * self._written, self._chunk // _FIRST_PARTS, 1)
        return len(self._pending) if total >= early else 0

    def append_weights(
        self, axis: str, t_ns: int, weights: npt.ArrayLike, *, surface: bool
    ) -> None:
        """Add the weights of an axis at an instant; they are written with the next records.

        Weights that equal the last ones are left out, and those of axes without any in the header.

        Args:
            axis: Name of the axis.
            t_ns: Instant, on the clock of the records.
            weights: The weights, in the order of the loop; copied.
            surface: Whether they are the coefficients of a surface, and not the weights of stops.
        """
        row, last = WeightsRow(t_ns, np.array(weights, np.float64), surface), self._newest.get(axis)
        if axis not in self._weighted:
            return
        if last and surface == last.surface and np.array_equal(row.weights, last.weights):
            return
        self._newest[axis] = row
        self._weights.setdefault(axis, []).append(row)

    def append_events(self, events: Iterable[StageEvent]) -> None:
        """Add events; they are written with the next records."""
        self._events.extend(events)

    def append_model(self, t_ns: int, axis: str, text: str) -> None:
        """Add a model that an axis has adopted; it is written with the next records.

        Args:
            t_ns: Instant, on the clock of the records.
            axis: Name of the axis.
            text: Text of the model file.
        """
        self._models.append(AdoptedModel(t_ns, axis, text))

    def close(self) -> None:
        """Write the remaining records and close the file; a second call does nothing.

        Raises:
            OSError: If the disk refuses them; the file is closed nevertheless.
        """
        if not self._file:
            return
        try:
            self._write(len(self._pending))
        finally:
            try:
                self._file.close()
            finally:
                self._reserved.release()

    def _write(self, count: int) -> None:
        portion, rest = self._pending[:count], self._pending[count:].copy()
        gaps, weights, events, models = self._gaps, self._weights, self._events, self._models
        # Cleared before the write: if it fails, `close` must not write these records again.
        self._pending, self._gaps, self._weights = self._pending[:0], [], {}
        self._events, self._models = [], []
        size = portion.nbytes + sum(row.weights.nbytes for rows in weights.values() for row in rows)
        size += 2 * EVENT_BYTES * len(events) + MODEL_BYTES * len(models)
        # Twice the size, because incompressible values get a little larger.
        self._reserved.reserve(self._file.id.get_filesize() + 2 * size + self._spare_bytes)
        try:
            for axis, rows in weights.items():
                self._columns.write_weights(axis, rows)
            self._columns.write_events(events, models)
            self._columns.write(portion, gaps)
            self._file.flush()
        except RuntimeError as error:  # h5py raises this for some disk errors
            raise OSError(f"{self._file.filename}: {error}") from error
        self._pending, self._written = rest, self._written + count


def _spare_bytes(header: TelemetryHeader, dtype: np.dtype[np.void]) -> int:
    of_axis = len(dtype["axes"].base.names or ())
    columns = len(dtype.names or ()) + len(header.axes) * (of_axis + 3) + _SIDE_COLUMNS
    notes = sum(len(text.encode()) for text in header.notes.values())
    chunks = 64 * 8 * sum(header.weights.values())
    return columns * _SPARE_BYTES + notes + chunks
