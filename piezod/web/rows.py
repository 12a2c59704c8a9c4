"""Intervals of telemetry as rows for a page: merged to lower rates, and sent as columns."""

import json
import time
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Final

from piezod.messages.documents import Document

RATE_HZ: Final = 30.0
"""Rate of the telemetry that a stage sends; a page gets this rate or a lower one."""
_EARLY: Final = 0.5
"""A row is due when at most this part of the daemon's interval is left."""
_LATE: Final = 0.25
"""A row that comes later than this part of the daemon's interval delays the next ones."""


class Row:
    """One interval of one stage.

    Args:
        stage: Name of the stage.
        document: The interval, as the daemon sends it, with `unix_s`.
    """

    def __init__(self, stage: str, document: Document) -> None:
        self.stage, self.document = stage, document

    def fits(self, other: "Row") -> bool:
        """Return whether one event may have both rows: they are of the same axes."""
        axes, others = self.document["axes"].keys(), other.document["axes"].keys()
        return self.stage == other.stage and axes == others

    @cached_property
    def text(self) -> str:
        """The event with this row alone; made once for all tabs."""
        return telemetry_event((self,))


class Decimator:
    """Hands rows on at a lower rate. Merged rows keep every minimum and maximum.

    Args:
        rate_hz: Rate, in Hz, at most `RATE_HZ`.
        put: Takes the rows.
    """

    def __init__(self, rate_hz: float, put: Callable[[Row], None]) -> None:
        self.rate_hz, self._put = rate_hz, put
        self._due_s = 0.0
        self._waiting: Row | None = None

    def feed(self, row: Row) -> None:
        """Take the next row of the stage."""
        if self._waiting is not None:
            row = Row(row.stage, merged(self._waiting.document, row.document))
        now_s: float = row.document["t_s"]
        if now_s + _EARLY / RATE_HZ < self._due_s:
            self._waiting = row
            return
        self._waiting = None
        # After a pause there is nothing to catch up.
        self._due_s = max(self._due_s, now_s - _LATE / RATE_HZ) + 1.0 / self.rate_hz
        self._put(row)


def with_time(document: Document) -> Document:
    """Return an interval with `unix_s`: the time of its last cycle, in s since 1970."""
    return {**document, "unix_s": document["t_s"] - time.monotonic() + time.time()}


def telemetry_event(rows: Sequence[Row]) -> str:
    """Return the event of some rows of one stage, at least one, as columns."""
    columns = as_columns([row.document for row in rows])
    return encoded({"event": "telemetry", "stage": rows[0].stage, **columns})


def as_columns(documents: Sequence[Document]) -> Document:
    """Return documents with the same keys as one, with an array for each value."""
    return {key: _column([each.get(key) for each in documents]) for key in documents[-1]}


def merged(older: Document, newer: Document) -> Document:
    """Return two intervals as one; `faults` has those of both."""
    late_us = [each for each in (older["late_max_us"], newer["late_max_us"]) if each is not None]
    return {
        **newer,
        "cycles": older["cycles"] + newer["cycles"],
        "lost": older["lost"] + newer["lost"],
        "faults": list(dict.fromkeys((*older["faults"], *newer["faults"]))),
        "late_max_us": max(late_us, default=None),
        "axes": {
            name: _merged_axis(older["axes"].get(name, axis), axis)
            for name, axis in newer["axes"].items()
        },
    }


def encoded(document: Document) -> str:
    """Return compact JSON.

    Raises:
        ValueError: If a number is not finite.
    """
    return json.dumps(document, allow_nan=False, separators=(",", ":"))


def _column(values: list[Any]) -> Any:
    return as_columns(values) if all(isinstance(each, dict) for each in values) else values


def _merged_axis(older: Document, newer: Document) -> Document:
    return {
        key: _merged_range(older[key], value) if isinstance(value, dict) else value
        for key, value in newer.items()
    }


def _merged_range(older: Document, newer: Document) -> Document:
    low = [each["min"] for each in (older, newer) if each["min"] is not None]
    high = [each["max"] for each in (older, newer) if each["max"] is not None]
    return {**newer, "min": min(low, default=None), "max": max(high, default=None)}
