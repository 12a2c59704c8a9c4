"""The growing datasets of a recording of a running stage."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final, NamedTuple

import h5py
import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

import piezod
from piezod.records.nexus import grow, growing_column, new_data, new_entry, new_group
from piezod.records.recording.events import AdoptedModel, EventColumns
from piezod.records.recording.header import TelemetryHeader
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S

ENTRY: Final = "recording"
_SIDE_CHUNK: Final = 64
"""Rows per chunk of data that are rarer than records."""
_ABOUT: Final = (
    "Every cycle of the loop of a stage, one row per cycle; all columns of `cycles` and of one "
    "`axis_…` have the same rows. Each dataset has its `units` and a `description`; the members of "
    "an enumeration are in its type and in `values`, the bits of a mask in `bits`. NaN is an "
    "unknown or invalid value. `rate_hz`: cycles per second. `start_ns`: instant of t_s = 0 on the "
    "clock of all columns in ns, which does not jump; `start_time` is the time of day then. "
    "`lost`: cycles that ran and are missing in this file, see `gaps`. `part`: number of the file, "
    "if the recording has several."
)
_CYCLES: Final = "The loop: its timing, the state of the stage, the faults."
_AXIS: Final = (
    "Displacement, command and drive of axis {axis}. A voltage that is written in one row is in "
    "force in the next; `in_force_v` belongs to the sample of the same row."
)
_WEIGHTS: Final = (
    "Weights of the inverse model of axis {axis} in use, whenever they changed: first those of the "
    "left operators, then those of the right ones; of a surface, see `weights_form`, the "
    "coefficients, four for each of six widths of a loop."
)
FORMS: Final = {"stops": 0, "surface": 1}
"""Forms of a model: the values of `weights_form`."""
_OWN: Final = {
    "t_s": "Instant of the cycle since `start_ns`.",
    "gaps": "Rows of (index of the first row after the gap, number of missing cycles).",
    "weights": "One row per instant of weights_t_s; NaN after the weights of a model with fewer.",
    "weights_t_s": "Instant since `start_ns` from which the weights hold.",
    "weights_form": "Form of the model of the row. It changes if the axis adopts another model, "
    "see `adopted_models`; `model_…` is the one at the start.",
}
"""Descriptions of the datasets that are not fields of a record."""


class WeightsRow(NamedTuple):
    """Weights of an axis at an instant."""

    t_ns: int  #: The instant, on the clock of the records.
    weights: NDArray[np.float64]  #: The weights, shape (n_weights,).
    surface: bool  #: Whether they are the coefficients of a surface, and not the weights of stops.


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
        self._entry = _lay_out_entry(file, header)
        self._gaps = _growing(self._entry, "gaps", np.dtype("i8"), _SIDE_CHUNK, 2)
        cycles = new_data(self._entry, "cycles", "late_ns", about=_CYCLES)
        self._t_s = _growing(cycles, "t_s", np.dtype("f8"), chunk)
        # Columns by index of their axis and name; the cycle itself has the index -1.
        self._columns = {
            (-1, name): self._column(cycles, name, dtype[name])
            for name in _public_names(dtype)
            if name not in ("axes", "end_seq")  # `end_seq` only protects the shared memory
        }
        self._weights: dict[str, tuple[h5py.Dataset, ...]] = {}
        for index, axis in enumerate(header.axes):
            self._lay_out_axis(index, axis, dtype["axes"].base)
        self._events = EventColumns(self._entry, header.start_ns)

    def write(self, portion: NDArray[Any], gaps: Sequence[tuple[int, int]]) -> None:
        """Add records, and the gaps before or between them."""
        for (axis, name), dataset in self._columns.items():
            grow(dataset, portion[name] if axis < 0 else portion["axes"][:, axis][name])
        # Time is written last: a reader that sees a time also finds all other columns.
        grow(self._t_s, self._seconds(portion["t_ns"]))
        grow(self._gaps, np.array(gaps, "i8").reshape(-1, 2))
        lost = sum(number for _, number in gaps)
        # `modify` writes in place; in SWMR mode no attribute can be created.
        self._entry.attrs.modify("lost", self._entry.attrs["lost"] + lost)

    def write_weights(self, axis: str, rows: Sequence[WeightsRow]) -> None:
        """Add rows of weights of an axis."""
        weights, forms, times = self._weights[axis]
        # An adopted model may have more weights than the one at the start.
        width = max(weights.shape[1], *(row.weights.size for row in rows))
        weights.resize(width, axis=1)
        values = np.full((len(rows), width), np.nan)
        for at, row in enumerate(rows):
            values[at, : row.weights.size] = row.weights
        grow(weights, values)
        grow(forms, np.array([FORMS["surface" if row.surface else "stops"] for row in rows], "u1"))
        grow(times, self._seconds(np.array([row.t_ns for row in rows])))

    def write_events(self, events: Sequence[StageEvent], models: Sequence[AdoptedModel]) -> None:
        """Add events and adopted models."""
        if events:
            self._events.write_events(events)
        if models:
            self._events.write_models(models)

    def _seconds(self, t_ns: NDArray[Any]) -> NDArray[np.float64]:
        return np.asarray((t_ns - self._header.start_ns) / NS_PER_S)

    def _lay_out_axis(self, index: int, axis: str, fields: np.dtype[np.void]) -> None:
        about = _AXIS.format(axis=axis)
        group = new_data(self._entry, f"axis_{axis}", "position_um", about=about)
        group.attrs["axis"] = axis
        group.attrs["auxiliary_signals"] = ["command_um", "drive_v"]
        group["t_s"] = self._t_s  # a hard link: all axes share the time of the cycles
        for name in _public_names(fields):
            self._columns[index, name] = self._column(group, name, fields[name])
        if (unit := self._header.units.get(axis)) is not None:
            for name, column in group.items():
                if name.endswith("_um"):
                    column.attrs["units"] = unit
        if width := self._header.weights.get(axis):
            about = _WEIGHTS.format(axis=axis)
            weights = new_data(self._entry, f"weights_{axis}", "weights", "weights_t_s", about)
            weights.attrs["surface"] = axis in self._header.surfaces
            forms = h5py.enum_dtype(FORMS, basetype="u1")
            self._weights[axis] = (
                # It grows in both directions; its chunks have the first width.
                _growing(
                    weights,
                    "weights",
                    "f8",
                    _SIDE_CHUNK,
                    width,
                    maxshape=(None, None),
                    fillvalue=np.nan,
                ),
                _growing(weights, "weights_form", forms, _SIDE_CHUNK),
                _growing(weights, "weights_t_s", np.dtype("f8"), _SIDE_CHUNK),
            )
            self._weights[axis][1].attrs["values"] = _numbered(FORMS)

    def _column(self, group: h5py.Group, name: str, dtype: np.dtype[Any]) -> h5py.Dataset:
        header = self._header
        names = header.names.get(name, ())
        if names:
            numbers = {text: number for number, text in enumerate(names)}
            dtype = h5py.enum_dtype(numbers, basetype=dtype)
        column = growing_column(group, name, dtype, self._chunk)
        if name in header.descriptions:
            column.attrs["description"] = header.descriptions[name]
        # The names are in the type, too, but many viewers show only the numbers.
        for attribute, texts in (("values", names), ("bits", header.bits.get(name, ()))):
            if texts:
                column.attrs[attribute] = _numbered(texts)
        return column


def _numbered(texts: Iterable[str]) -> list[str]:
    """Return names with their numbers, for viewers that show only the numbers."""
    return [f"{number} = {text}" for number, text in enumerate(texts)]


def _lay_out_entry(file: h5py.File, header: TelemetryHeader) -> h5py.Group:
    entry = new_entry(file, ENTRY, creator="piezod", creator_version=piezod.__version__)
    entry["title"], entry["start_time"] = header.title, header.started_at
    entry.attrs["description"] = _ABOUT
    entry.attrs["rate_hz"], entry.attrs["start_ns"] = header.rate_hz, header.start_ns
    entry.attrs["axis_names"], entry.attrs["lost"] = list(header.axes), np.int64(0)
    entry.attrs["default"], entry.attrs["part"] = f"axis_{header.axes[0]}", header.part
    for name, text in header.notes.items():
        new_group(entry, name, "NXnote")["data"] = text
    return entry


def _growing(
    group: h5py.Group, name: str, dtype: npt.DTypeLike, chunk: int, *row: int, **options: Any
) -> h5py.Dataset:
    return growing_column(group, name, dtype, chunk, *row, about=_OWN[name], **options)


def _public_names(dtype: np.dtype[np.void]) -> Iterator[str]:
    return (name for name in dtype.names or () if not name.startswith("_"))
