"""What to know about a recording before its numbers are used: states, modes, faults, and gaps."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezod.config.states import State
from piezod.records.frozen import FloatArray
from piezod.records.recording.reader import RecordedTelemetry
from piezod.units import NS_PER_S

LATE_PART: Final = 0.5
"""A cycle is marked as late if it began later than this share of a period."""


class Span(NamedTuple):
    """A part of a recording in which a name stays the same."""

    begin_s: float  #: Instant of its first cycle, in s.
    end_s: float  #: Instant of the first cycle after it, or of the last cycle, in s.
    name: str  #: The name.


class Irregularity(NamedTuple):
    """One kind of missing or late data."""

    name: str  #: Description for people, in the plural.
    cases: int  #: Number of missing periods or of affected cycles.
    t_s: FloatArray  #: Instants of the cycles at which they show, in s, shape (n,).


def names_of(telemetry: RecordedTelemetry, name: str, column: NDArray[Any]) -> NDArray[np.str_]:
    """Return the names of the numbers of a column, shape (n_records,)."""
    names: NDArray[np.str_] = np.array(telemetry.header.names[name], dtype=np.str_)[column]
    return names


def modes_in_run(telemetry: RecordedTelemetry, axis: str) -> NDArray[np.int16]:
    """Return the number of the mode in each cycle in RUN, and -1 in other states."""
    state, mode = telemetry.cycles["state"], telemetry.axes[axis]["mode"]
    running = state == list(telemetry.header.names["state"]).index(State.RUN)
    return np.where(running, mode.astype(np.int16), np.int16(-1))


def states(telemetry: RecordedTelemetry, axis: str) -> tuple[Span, ...]:
    """Return the states of the stage over time, in RUN with the mode of the axis."""
    names, modes = telemetry.header.names, modes_in_run(telemetry, axis)
    state = telemetry.cycles["state"].astype(np.int16)
    # Numbers, not texts: an hour of texts has 200 MB.
    numbers = np.where(modes < 0, state, len(names["state"]) + modes)
    texts = (*names["state"], *names["mode"])
    return _spans(telemetry.cycles["t_s"], [numbers], lambda row: texts[numbers[row]])


def faults_present(telemetry: RecordedTelemetry) -> NDArray[np.str_]:
    """Return the names of the present faults in each cycle, as in "L2 S5", shape (n_records,)."""
    return _fault_names(telemetry, "present")


def faults_latched(telemetry: RecordedTelemetry) -> NDArray[np.str_]:
    """Return the names of the latched faults in each cycle, shape (n_records,)."""
    return _fault_names(telemetry, "latched")


def fault_spans(telemetry: RecordedTelemetry) -> dict[str, tuple[Span, ...]]:
    """Return the parts of a recording in which a fault was present, by the name of the fault."""
    bits = _bits(telemetry, "present")
    columns = [telemetry.cycles[name] for name in bits]
    spans = _spans(
        telemetry.cycles["t_s"],
        columns,
        lambda row: _names_of_bits([int(column[row]) for column in columns], bits.values()),
    )
    faults = dict.fromkeys(fault for span in spans for fault in span.name.split())
    return {fault: tuple(span for span in spans if fault in span.name.split()) for fault in faults}


def irregularities(telemetry: RecordedTelemetry, axis: str) -> tuple[Irregularity, ...]:
    """Return the kinds of missing or late data that a recording has."""
    cycles, t_s = telemetry.cycles, telemetry.cycles["t_s"]
    skipped = np.diff(cycles["skipped"], prepend=cycles["skipped"][:1])
    seq = cycles["seq"]
    lost = np.maximum(np.diff(seq, prepend=seq[:1] - 1) - 1, 0)
    invalid = ~np.isfinite(telemetry.axes[axis]["position_um"])
    late = cycles["late_ns"] * telemetry.header.rate_hz > LATE_PART * NS_PER_S
    kinds = {
        "periods skipped by the loop": skipped,
        "records lost": lost,
        "invalid samples": invalid,
        "late cycles": late,
    }
    found = (
        Irregularity(name, int(np.sum(counts)), t_s[np.asarray(counts) > 0])
        for name, counts in kinds.items()
    )
    return tuple(each for each in found if each.cases)


def _fault_names(telemetry: RecordedTelemetry, mask: str) -> NDArray[np.str_]:
    """Return the names of the bits of a mask, which may be in two columns."""
    bits = _bits(telemetry, mask)
    if not bits:
        return np.full(telemetry.cycles["t_s"].size, "")
    columns = np.stack([telemetry.cycles[name] for name in bits], axis=1)
    # Masks change seldom: each different one is spelt out once.
    masks, places = np.unique(columns, axis=0, return_inverse=True)
    texts = [_names_of_bits(row.tolist(), bits.values()) for row in masks]
    return np.array(texts, dtype=np.str_)[places.reshape(-1)]


def _bits(telemetry: RecordedTelemetry, mask: str) -> dict[str, Sequence[str]]:
    """Return the columns of a mask with the names of their bits; none of an older recording."""
    return {name: bits for name, bits in telemetry.header.bits.items() if name.startswith(mask)}


def _names_of_bits(numbers: Iterable[int], bits: Iterable[Sequence[str]]) -> str:
    return " ".join(
        bit
        for number, names in zip(numbers, bits, strict=True)
        for place, bit in enumerate(names)
        if number >> place & 1
    )


def _spans(
    t_s: FloatArray, columns: Sequence[NDArray[Any]], name_of: Callable[[int], str]
) -> tuple[Span, ...]:
    """Return the parts in which no column changes, each with the name of its first row."""
    if not t_s.size:
        return ()
    changes = np.zeros(t_s.size, dtype=bool)
    changes[0] = True
    for column in columns:
        changes[1:] |= column[1:] != column[:-1]
    begins = np.flatnonzero(changes)
    ends = np.append(begins[1:], t_s.size - 1)
    return tuple(
        Span(float(t_s[begin]), float(t_s[end]), name_of(int(begin)))
        for begin, end in zip(begins, ends, strict=True)
    )
