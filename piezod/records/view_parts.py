"""What a viewer of a recording shows beside its columns: what is inside, marks, and the loop."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import Any, Final, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.errors import DataError
from piezod.reading.opened import damage_is_an_error, open_recording
from piezod.records.frozen import FloatArray
from piezod.records.nexus import axis_names
from piezod.records.recording.events import read_events
from piezod.records.recording.layout import stage_entry
from piezod.records.recording.marks import LATE_PART
from piezod.records.view import view
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S

_MARK_BUCKETS: Final = 400
"""Marks of one kind that a view has at most."""
_READ_ROWS: Final = 2**18
_PICKS: Final = 4
"""Rows that a bucket of the loop keeps: those of both extremes of both quantities."""


class Column(NamedTuple):
    """A column of a recording."""

    name: str  #: Its name, as in "axis_x/position_um".
    unit: str  #: Its unit; empty if it has none.
    description: str  #: Its meaning, for people.
    names: tuple[str, ...]  #: Names of its numbers, from 0; empty if they have none.


class Contents(NamedTuple):
    """What a recording has."""

    title: str  #: Description, for people.
    started_at: str  #: Time of day of 0 s, ISO 8601.
    rate_hz: float  #: Cycles per second.
    axes: tuple[str, ...]  #: Names of the axes.
    begin_s: float  #: Instant of its first row, in s; NaN without rows.
    end_s: float  #: Instant of its last row, in s; NaN without rows.
    rows: int  #: Number of recorded cycles.
    lost: int  #: Number of cycles that ran and are missing.
    columns: tuple[Column, ...]  #: Its columns.


class Mark(NamedTuple):
    """Something to know about an instant or a short span of a recording."""

    begin_s: float  #: Its begin, in s.
    end_s: float  #: Its end, in s.
    kind: str  #: "late", "skipped", "lost", "invalid", or that of an event, as "fault" or "state".
    text: str  #: Description for people.


class DriveLoop(NamedTuple):
    """Displacement against drive: rows in the order of time, each array of shape (n,)."""

    t_s: FloatArray  #: Instants, in s.
    drive_v: FloatArray  #: Voltage in force, in V.
    position_um: FloatArray  #: Position of the same row, in µm.


def contents(path: Path) -> Contents:
    """Return what a recording has; it may still grow.

    Raises:
        DataError: If the file is not a recording of a stage.
        OSError: If it cannot be opened.
    """
    with _opened(path) as entry:
        t_s = entry["cycles/t_s"]
        t_s.refresh()
        rows = len(t_s)
        axes = axis_names(entry)
        groups = ("cycles", *(f"axis_{name}" for name in axes))
        return Contents(
            title=str(entry["title"].asstr()[()]),
            started_at=str(entry["start_time"].asstr()[()]),
            rate_hz=float(entry.attrs["rate_hz"]),
            axes=axes,
            begin_s=float(t_s[0]) if rows else float("nan"),
            end_s=float(t_s[rows - 1]) if rows else float("nan"),
            rows=rows,
            lost=int(entry.attrs["lost"]),
            columns=tuple(
                _column(f"{group}/{name}", dataset)
                for group in groups
                for name, dataset in entry[group].items()
                if name != "t_s"
            ),
        )


def marks(path: Path, axis: str, begin_s: float = -inf, end_s: float = inf) -> tuple[Mark, ...]:
    """Return what to know about a span, in the order of time.

    Marks that are close to each other in a long span are joined, so that their number is bounded.
    Of more than 400 events, those of the lowest severity are left out first.

    Args:
        path: Path of the file.
        axis: Name of the axis whose samples are looked at.
        begin_s: Begin of the span, in s.
        end_s: End of the span, exclusive, in s.

    Raises:
        DataError: If the file is not a recording of a stage, or has no such axis.
        OSError: If it cannot be opened.
    """
    with _opened(path) as entry:
        rate_hz = float(entry.attrs["rate_hz"])
        lost = _lost(entry)
        start_ns, events = int(entry.attrs["start_ns"]), read_events(entry)
    late, skipped, samples = (
        view(path, column, begin_s, end_s, _MARK_BUCKETS)
        for column in ("cycles/late_ns", "cycles/skipped", f"axis_{axis}/position_um")
    )
    limit_ns = LATE_PART * NS_PER_S / rate_hz
    before = np.concatenate((skipped.minimum[:1], skipped.maximum[:-1]))
    found = [
        *(
            Mark(begin, end, "late", f"a cycle began {worst / 1000:.0f} µs late")
            for begin, end, worst in zip(late.begin_s, late.end_s, late.maximum, strict=True)
            if worst > limit_ns
        ),
        *(
            Mark(begin, end, "skipped", f"periods skipped by the loop: {number}")
            for begin, end, number in zip(
                skipped.begin_s, skipped.end_s, skipped.maximum - before, strict=True
            )
            if number > 0
        ),
        *(
            Mark(begin, end, "invalid", f"invalid samples: {number}")
            for begin, end, number in zip(
                samples.begin_s, samples.end_s, samples.rows - samples.valid, strict=True
            )
            if number > 0
        ),
        *(mark for mark in lost if begin_s <= mark.begin_s < end_s),
        *_event_marks(events, start_ns, begin_s, end_s),
    ]
    return tuple(sorted((_plain(mark) for mark in found), key=lambda mark: mark.begin_s))


def loop(
    path: Path, axis: str, begin_s: float = -inf, end_s: float = inf, points: int = 4000
) -> DriveLoop:
    """Return displacement against drive, in a number of rows that a screen can show.

    Of each bucket of rows the extremes of both quantities are kept, so that no loop loses its tips.
    Rows without a valid sample are left out.

    Args:
        path: Path of the file.
        axis: Name of the axis.
        begin_s: Begin of the span, in s.
        end_s: End of the span, exclusive, in s.
        points: Largest number of rows, from 4.

    Raises:
        DataError: If the file is not a recording of a stage, or has no such axis.
        OSError: If it cannot be opened.
        ValueError: If `points` is below 4.
    """
    if points < _PICKS:
        raise ValueError(f"points must be {_PICKS} or more (got {points})")
    with _opened(path) as entry:
        group = _axis_group(entry, axis)
        columns = [group[name] for name in ("t_s", "in_force_v", "position_um")]
        for column in columns:
            column.refresh()
        rows = min(len(column) for column in columns)
        begin, end = np.searchsorted(columns[0][:rows], [begin_s, end_s])
        size = max(1, -(-int(end - begin) * _PICKS // points))  # rows of a bucket
        portion = max(_READ_ROWS // size, 1) * size
        parts = [
            _tips([column[start : min(start + portion, end)] for column in columns], size)
            for start in range(int(begin), int(end), portion)
        ]
    if not parts:
        return DriveLoop(*(np.empty(0) for _ in DriveLoop._fields))
    return DriveLoop(*(np.concatenate(part) for part in zip(*parts, strict=True)))


@contextmanager
def _opened(path: Path) -> Iterator[h5py.Group]:
    with open_recording(path) as file, damage_is_an_error(path):
        yield stage_entry(file)


def _axis_group(entry: h5py.Group, axis: str) -> h5py.Group:
    if axis not in (names := axis_names(entry)):
        raise DataError(f"the recording has no axis {axis!r}; its axes are {', '.join(names)}")
    return entry[f"axis_{axis}"]


def _column(name: str, dataset: h5py.Dataset) -> Column:
    numbers = h5py.check_enum_dtype(dataset.dtype) or {}
    return Column(
        name,
        str(dataset.attrs.get("units", "")),
        str(dataset.attrs.get("description", "")),
        tuple(sorted(numbers, key=numbers.__getitem__)),
    )


def _lost(entry: h5py.Group) -> list[Mark]:
    t_s = entry["cycles/t_s"]
    gaps = entry["gaps"][-_MARK_BUCKETS:]
    found = []
    for row, number in gaps.tolist():
        if row < len(t_s):
            end_s = float(t_s[row])
            begin_s = float(t_s[row - 1]) if row else end_s
            found.append(Mark(begin_s, end_s, "lost", f"cycles missing in the file: {number}"))
    return found


def _event_marks(
    events: tuple[StageEvent, ...], start_ns: int, begin_s: float, end_s: float
) -> list[Mark]:
    inside = [
        (each, t_s)
        for each in events
        if begin_s <= (t_s := (each.t_ns - start_ns) / NS_PER_S) < end_s
    ]
    severities = ("error", "warning", "info")
    inside.sort(key=lambda each: severities.index(each[0].severity))
    return [Mark(t_s, t_s, each.kind, each.text) for each, t_s in inside[:_MARK_BUCKETS]]


def _plain(mark: Mark) -> Mark:
    return mark._replace(begin_s=float(mark.begin_s), end_s=float(mark.end_s))


def _tips(columns: list[NDArray[Any]], size: int) -> list[FloatArray]:
    """Return the rows with the extremes of drive and position in each bucket of a portion."""
    valid = np.isfinite(columns[1]) & np.isfinite(columns[2])
    columns = [column[valid] for column in columns]
    if size <= _PICKS:
        return columns
    kept: set[int] = set()
    for start in range(0, columns[0].size, size):
        for column in columns[1:]:
            part = column[start : start + size]
            kept.update((start + int(part.argmin()), start + int(part.argmax())))
    rows = np.array(sorted(kept), np.intp)
    return [column[rows] for column in columns]
