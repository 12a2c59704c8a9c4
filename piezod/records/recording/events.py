"""Events and adopted models in a recording: rows that are rarer than cycles."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from piezod.records.nexus import grow, growing_column, new_group
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S

EVENTS: Final = "event_log"
MODELS: Final = "adopted_models"
OLD_EVENTS: Final = "events"
"""Note of a flight record with one line of JSON per event."""
MODEL_BYTES: Final = 128 * 1024
"""Room for the text of a model; the largest one has 4000 numbers of up to 25 characters."""
_SEVERITIES: Final = {"info": 0, "warning": 1, "error": 2}
_ABOUT: Final = {
    EVENTS: "The log of the loop: one row per event, in the order of time.",
    MODELS: "Models that axes adopted during the recording; those of the start are in `model_…`.",
}
_DESCRIPTIONS: Final = {
    "t_s": "Instant since `start_ns`.",
    "t_ns": "The same instant, on the clock of the cycles.",
    "severity": "How serious the event is.",
    "kind": "Kind of event, as state, fault, fault-cleared, request.",
    "fault": "Id of the fault; empty if there is none.",
    "axis": "Name of the axis; of an event, empty if it concerns all.",
    "measured": "Measured value; NaN if there is none. The text has its unit.",
    "limit": "Limit of that value; NaN if there is none.",
    "text": "Text for people; of a model, the text of its model file.",
}


class AdoptedModel(NamedTuple):
    """A model that an axis adopted during a recording."""

    t_ns: int  #: Instant of the first cycle in which it was seen, on the clock of the records.
    axis: str  #: Name of the axis.
    text: str  #: Text of the model file.


class EventColumns:
    """The datasets of events and adopted models of an empty file.

    Args:
        entry: Entry of the file.
        start_ns: Instant of 0 s in the file.
    """

    def __init__(self, entry: h5py.Group, start_ns: int) -> None:
        self._start_ns = start_ns
        severity = h5py.enum_dtype(_SEVERITIES, basetype="u1")
        events = {"severity": severity, "kind": _text(32), "fault": _text(8), "axis": _text(32)}
        numbers = {"measured": "f8", "limit": "f8", "text": _text(512)}
        self._events = _lay_out(entry, EVENTS, events | numbers, 64)
        models = {"axis": _text(32), "text": _text(MODEL_BYTES)}
        self._models = _lay_out(entry, MODELS, models, 1)

    def write_events(self, events: Sequence[StageEvent]) -> None:
        """Add events."""
        rows = [event._asdict() for event in events]
        columns = {name: [row[name] for row in rows] for name in StageEvent._fields}
        columns["severity"] = [_SEVERITIES[severity] for severity in columns["severity"]]
        self._write(self._events, columns)

    def write_models(self, models: Sequence[AdoptedModel]) -> None:
        """Add adopted models."""
        rows = [model._asdict() for model in models]
        self._write(self._models, {name: [row[name] for row in rows] for name in rows[0]})

    def _write(
        self, datasets: Mapping[str, h5py.Dataset], columns: Mapping[str, list[Any]]
    ) -> None:
        t_s = (np.array(columns["t_ns"]) - self._start_ns) / NS_PER_S
        for name, dataset in datasets.items():
            values = t_s if name == "t_s" else _fitting(columns[name], dataset.dtype)
            grow(dataset, values)


def read_events(entry: h5py.Group) -> tuple[StageEvent, ...]:
    """Return the events of a recording; none of a file of an older version, but a flight record."""
    if EVENTS in entry:
        columns = _read(entry[EVENTS])
        names = {number: name for name, number in _SEVERITIES.items()}
        columns["severity"] = [names[number] for number in columns["severity"]]
        rows = zip(*(columns[name] for name in StageEvent._fields), strict=True)
        return tuple(StageEvent(*row) for row in rows)
    note = entry.get(OLD_EVENTS)
    text = "" if note is None else note["data"].asstr()[()]
    return tuple(StageEvent(**json.loads(line)) for line in text.splitlines())


def read_models(entry: h5py.Group) -> tuple[AdoptedModel, ...]:
    """Return the models that were adopted during a recording, in the order of time."""
    if MODELS not in entry:
        return ()
    columns = _read(entry[MODELS])
    rows = zip(*(columns[name] for name in AdoptedModel._fields), strict=True)
    return tuple(AdoptedModel(*row) for row in rows)


def _read(group: h5py.Group) -> dict[str, list[Any]]:
    # The instant is written last: a reader that sees one also finds the rest of the row.
    rows = len(group["t_s"])
    return {
        name: (dataset.asstr() if h5py.check_string_dtype(dataset.dtype) else dataset)[
            :rows
        ].tolist()
        for name, dataset in group.items()
    }


def _lay_out(
    entry: h5py.Group, name: str, fields: Mapping[str, Any], chunk: int
) -> dict[str, h5py.Dataset]:
    group = new_group(entry, name, "NXcollection")
    group.attrs["description"] = _ABOUT[name]
    rare = {"compression_opts": None, "shuffle": None}
    return {
        field: growing_column(group, field, dtype, chunk, about=_DESCRIPTIONS[field], **rare)
        for field, dtype in {"t_ns": "i8", **fields, "t_s": "f8"}.items()
    }


def _text(size_bytes: int) -> np.dtype[Any]:
    # A fixed length, because a file in SWMR mode takes no texts of varying length.
    dtype: np.dtype[Any] = h5py.string_dtype("utf-8", size_bytes)
    return dtype


def _fitting(values: list[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    if dtype.kind == "S":
        # Cut off between two characters.
        cut = (text.encode()[: dtype.itemsize].decode(errors="ignore") for text in values)
        return np.array([text.encode() for text in cut], dtype)
    return np.array(values, dtype)
