"""Reading of a recording that `writer` wrote, as a whole or in part."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.errors import DataError
from piezod.reading.hdf5_magic import is_hdf5
from piezod.reading.opened import damage_is_an_error, open_recording
from piezod.records.experiment_result import Recording
from piezod.records.nexus import CHUNK_CACHE_BYTES, axis_names
from piezod.records.recording.columns import ENTRY, FORMS
from piezod.records.recording.events import AdoptedModel, read_events, read_models
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.header_reader import names_of_numbers, read_header
from piezod.records.recording.layout import (
    Named,
    check_numbers,
    check_room,
    check_time,
    stage_entry,
)
from piezod.telemetry.record import StageEvent

_PORTION: Final = 2**15
"""Records that a portion has at most."""
_WEIGHTS: Final = ("weights", "weights_t_s", "weights_form")


@dataclass(frozen=True, eq=False)
class RecordedTelemetry:
    """A recording of a running stage, or a part of one."""

    header: TelemetryHeader  #: Header of the whole recording.
    lost: int  #: Number of lost records in the whole recording.
    #: Rows of (index of the first record after it, records lost) of the whole recording, shape (n,
    #: 2).
    gaps: NDArray[np.int64]
    #: Columns by name, each of shape (n_records,); numbers for fields with names in the header.
    cycles: dict[str, NDArray[Any]]
    axes: dict[str, dict[str, NDArray[Any]]]  #: Columns of each axis, by its name.
    #: `weights`, shape (n_snapshots, n_weights), `weights_t_s`, shape (n_snapshots,), and
    #: `weights_form`, of `FORMS`, the same, of each axis; (0, 0) if they were not recorded. A row
    #: of a model with fewer weights than another one ends with NaN.
    weights: dict[str, dict[str, NDArray[Any]]]
    events: tuple[StageEvent, ...] = ()  #: The log of the loop during the whole recording.
    adopted: tuple[AdoptedModel, ...] = ()  #: Models that axes adopted during the whole recording.

    def chosen_axis(self, axis: str | None) -> str:
        """Return the name of an axis: the given one, or the only one.

        Raises:
            DataError: If there is no such axis, or there are several and none is given.
        """
        names = ", ".join(self.axes)
        if axis is None and len(self.axes) > 1:
            raise DataError(f"the recording has several axes, {names}: name one with --axis")
        if axis is not None and axis not in self.axes:
            raise DataError(f"the recording has no axis {axis}; its axes are {names}")
        return axis or names

    def recordings(self) -> tuple[Recording, ...]:
        """Return the axes as recordings of an experiment, without true displacement.

        Raises:
            DataError: If there is no record.
        """
        return tuple(map(self._recording, self.axes))

    def _recording(self, axis: str) -> Recording:
        columns = self.axes[axis]
        weights, weights_t_s, surface = self.first_weights(axis)
        t_s = self.cycles["t_s"]
        return Recording(
            axis=axis,
            case=self.header.started_at,
            mode=self._mode(columns["mode"]),
            title=self.header.title,
            t_s=t_s,
            drive_v=columns["drive_v"],
            position_um=columns["position_um"],
            command_um=columns["command_um"],
            uncompensated_v=columns["uncompensated_v"],
            true_um=np.full(t_s.size, np.nan),
            weights=weights,
            weights_t_s=weights_t_s,
            surface=surface,
        )

    def first_weights(
        self, axis: str, begin_s: float = -inf, end_s: float = inf
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]:
        """Return the weights of one form and number, of the first model in an interval, of an axis.

        Weights of a model of another form or number, which was adopted later, are left out.

        Args:
            axis: Name of the axis.
            begin_s: Begin of the interval, in s.
            end_s: Its end, exclusive, in s.

        Returns:
            The weights, shape (n, n_weights), their instants in s, shape (n,), and whether they are
            the coefficients of a surface.
        """
        weights, t_s, forms = (self.weights[axis][name] for name in _WEIGHTS)
        within = (t_s >= begin_s) & (t_s < end_s)
        if not within.any():
            return weights[:0], t_s[:0], axis in self.header.surfaces
        numbers = np.count_nonzero(np.isfinite(weights), axis=1)
        first, number = forms[within][0], numbers[within][0]
        within &= (forms == first) & (numbers == number)
        return weights[within, :number], t_s[within], bool(first == FORMS["surface"])

    def model_text(self, axis: str) -> str | None:
        """Return the text of the model file in use in the first cycle; None without a model."""
        begin_ns = self.cycles["t_ns"][0]
        adopted = [each for each in self.adopted if each.axis == axis and each.t_ns <= begin_ns]
        return adopted[-1].text if adopted else self.header.notes.get(f"model_{axis}")

    def _mode(self, numbers: NDArray[Any]) -> str:
        found = np.unique(numbers)
        return self.header.names["mode"][int(found[0])] if found.size == 1 else "mixed"


def is_recording(path: Path) -> bool:
    """Return whether a file is the recording of a stage, perhaps a damaged one; else it is another.

    Raises:
        DataError: If it is no regular file, or damaged HDF5.
        OSError: If it cannot be read.
    """
    if not is_hdf5(path):
        return False
    with open_recording(path, foreign=True) as file, damage_is_an_error(path):
        return ENTRY in file and "NX_class" in file.attrs


def read_telemetry(
    path: Path,
    begin_s: float = -inf,
    end_s: float = inf,
    columns: Collection[str] | None = None,
) -> RecordedTelemetry:
    """Return a recording; it may still be in progress, or incomplete.

    Args:
        path: Path of the file.
        begin_s: Start of the part to read, in s.
        end_s: End of the part to read, exclusive, in s.
        columns: Names of the columns to read; all if None.

    Raises:
        DataError: If the file is not a recording of a stage.
        OSError: If the file cannot be opened.
    """
    with _opened(path) as entry:
        return _read(entry, _rows(entry, begin_s, end_s), (begin_s, end_s), columns)


def read_portions(
    path: Path,
    begin_s: float = -inf,
    end_s: float = inf,
    columns: Collection[str] | None = None,
) -> Iterator[RecordedTelemetry]:
    """Yield a recording in portions of some 30,000 records; at least one, which may be empty.

    Arguments and errors are those of `read_telemetry`.
    """
    with _opened(path) as entry:
        rows, span_s = _rows(entry, begin_s, end_s), (begin_s, end_s)
        whole = _read(entry, slice(rows.start, rows.start), span_s, columns)
        for start in range(rows.start, max(rows.stop, rows.start + 1), _PORTION):
            cycles, axes = _read_columns(
                entry, slice(start, min(start + _PORTION, rows.stop)), columns
            )
            yield replace(whole, cycles=cycles, axes=axes)


@contextmanager
def _opened(path: Path) -> Iterator[h5py.Group]:
    with open_recording(path, rdcc_nbytes=CHUNK_CACHE_BYTES) as file, damage_is_an_error(path):
        yield stage_entry(file)


def _read(
    entry: h5py.Group,
    rows: slice,
    span_s: tuple[float, float],
    columns: Collection[str] | None,
) -> RecordedTelemetry:
    cycles, axes = _read_columns(entry, rows, columns)
    return RecordedTelemetry(
        header=read_header(entry),
        lost=int(entry.attrs["lost"]),
        gaps=entry["gaps"][()],
        cycles=cycles,
        axes=axes,
        weights={name: _weights(entry, name, *span_s) for name in axes},
        events=read_events(entry),
        adopted=read_models(entry),
    )


def _read_columns(
    entry: h5py.Group, rows: slice, names: Collection[str] | None
) -> tuple[dict[str, NDArray[Any]], dict[str, dict[str, NDArray[Any]]]]:
    """Return rows of the columns of the cycles, and of those of each axis."""
    groups = {axis: entry[f"axis_{axis}"] for axis in axis_names(entry)}
    chosen = [
        dataset
        for group in (entry["cycles"], *groups.values())
        for name, dataset in group.items()
        if names is None or name in names
    ]
    check_room(chosen, rows.stop - rows.start)
    axes: dict[str, dict[str, NDArray[Any]]] = {
        axis: Named(f"column of axis {axis}", _columns(group, rows, names))
        for axis, group in groups.items()
    }
    return Named("column", _columns(entry["cycles"], rows, names)), axes


def _rows(entry: h5py.Group, begin_s: float, end_s: float) -> slice:
    axes = [entry[f"axis_{axis}"] for axis in axis_names(entry)]
    return _part("t_s", [entry["cycles"], *axes], begin_s, end_s)


def _weights(entry: h5py.Group, axis: str, begin_s: float, end_s: float) -> dict[str, NDArray[Any]]:
    group = entry.get(f"weights_{axis}")
    if group is None:
        return {name: np.empty((0, 0) if name == "weights" else 0) for name in _WEIGHTS}
    part = _part("weights_t_s", [group], begin_s, end_s)
    check_room(group.values(), part.stop - part.start)
    found = _columns(group, part)
    # Files from before a recording noted the form of each row have that of the start.
    form = FORMS["surface" if group.attrs.get("surface", False) else "stops"]
    return {"weights_form": np.full(found["weights_t_s"].size, form, "u1")} | found


def _part(time: str, groups: Sequence[h5py.Group], begin_s: float, end_s: float) -> slice:
    # A write in progress, or an interrupted one, leaves columns of different lengths.
    size = min(len(dataset) for group in groups for dataset in group.values())
    check_room([groups[0][time]], size)
    t_s = groups[0][time][:size]
    check_time(t_s)
    begin, end = np.searchsorted(t_s, [begin_s, end_s])
    return slice(int(begin), max(int(begin), int(end)))


def _columns(
    group: h5py.Group, part: slice, names: Collection[str] | None = None
) -> dict[str, NDArray[Any]]:
    found = {
        name: dataset[part] for name, dataset in group.items() if names is None or name in names
    }
    for name, values in found.items():
        if (numbers := names_of_numbers(group[name])) and values.dtype.kind != "b":
            check_numbers(f"{group.name}/{name}", values, len(numbers))
    return found
