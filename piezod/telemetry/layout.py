"""What lies where in the memory that loop and supervisor share, and what a record holds.

A record is written by `struct`, because a loop needs no array for it, and read as a structured
array; both descriptions derive from `telemetry.record`. Numbers are little-endian; each record is a
multiple of eight bytes long, so that its sequence numbers are aligned.
"""

import json
from dataclasses import asdict, dataclass
from enum import Enum
from itertools import accumulate
from typing import Final, NamedTuple, Self, get_type_hints

import numpy as np

from piezod.config.daemon import DaemonConfig
from piezod.telemetry.record import AxisRecord, CycleHeader
from piezod.units import NS_PER_S, s_to_ns

PAGE: Final = 4096
WORDS: Final = 64
"""How many words of eight bytes there are for `words.Word`."""
REPORT_BYTES: Final = 16 * 1024
STREAM_WORDS: Final = 8
"""Words of one axis in the setpoint stream, a cache line."""
URGENT_SLOTS: Final = 4
URGENT_BYTES: Final = 1024
REQUEST_SLOTS: Final = 16
REQUEST_BYTES: Final = 256 * 1024
SLOT_HEADER: Final = 64
"""Bytes before the payload of a request or an answer."""
ANSWER_SLOTS: Final = 64
ANSWER_BYTES: Final = 512
MAX_WEIGHTS: Final = 2048
LEARNED_HEADER: Final = 8
"""Words before the weights of an axis."""
EVENT_SLOTS: Final = 512
EVENT_BYTES: Final = 512
RING_S: Final = 16.0
"""What the ring holds: the flight recorder wants 10 s, and time to come for them."""
RING_MAX_BYTES: Final = 64 * 1024 * 1024

_CODES: Final = {int: ("<i8", "q"), float: ("<f8", "d"), bool: ("?", "?")}
"""Type of a field: numpy's description of it, and that of `struct`."""
_MASK: Final = ("<u8", "Q")
_PLACE: Final = ("u1", "B")
"""A member of an enumeration is stored as its place in it."""


class Field(NamedTuple):
    """One field of a record in memory.

    Attributes:
        name: Its name; one that begins with "_" is a gap.
        dtype: Numpy's description of it.
        code: That of `struct`.
    """

    name: str
    dtype: str
    code: str


def fields_of(record: type[AxisRecord] | type[CycleHeader]) -> tuple[Field, ...]:
    """Return the fields of a record in memory, from its declaration.

    Gaps keep the fields of eight bytes, and the end, at multiples of eight.
    """
    fields: list[Field] = []
    at = 0
    for name, kind in get_type_hints(record).items():
        dtype, code = _described(name, kind)
        size = np.dtype(dtype).itemsize
        if at % size:
            fields.append(_gap(len(fields), -at % size))
            at += -at % size
        fields.append(Field(name, dtype, code))
        at += size
    if at % 8:
        fields.append(_gap(len(fields), -at % 8))
    return tuple(fields)


def _described(name: str, kind: type) -> tuple[str, str]:
    if name.endswith(("_lo", "_hi")):
        return _MASK
    return _PLACE if issubclass(kind, Enum) else _CODES[kind]


def _gap(place: int, size: int) -> Field:
    return Field(f"_gap{place}", f"V{size}", f"{size}x")


CYCLE_FIELDS: Final = fields_of(CycleHeader)
AXIS_FIELDS: Final = fields_of(AxisRecord)


def record_dtype(axes: int) -> np.dtype[np.void]:
    """Describe a record of this many axes; the field `axes` has shape (axes,)."""
    axis = np.dtype([(name, dtype) for name, dtype, _ in AXIS_FIELDS])
    cycle = [(name, dtype) for name, dtype, _ in CYCLE_FIELDS]
    return np.dtype([("seq", "<i8"), *cycle, ("axes", axis, (axes,)), ("end_seq", "<i8")])


def body_format(axes: int) -> str:
    """Describe the same for `struct`, without the sequence numbers at both ends."""
    cycle = "".join(field.code for field in CYCLE_FIELDS)
    return "<" + cycle + "".join(field.code for field in AXIS_FIELDS) * axes


def enumerations() -> dict[str, tuple[Enum, ...]]:
    """Return the fields that hold a place in an enumeration, each with the members."""
    hints = get_type_hints(CycleHeader) | get_type_hints(AxisRecord)
    return {name: tuple(kind) for name, kind in hints.items() if issubclass(kind, Enum)}


@dataclass(frozen=True, slots=True)
class Layout:
    """What the shared memory of a stage is made for.

    Attributes:
        axes: Names of the axes, in their order.
        capacity: Records in the ring.
        period_ns: Period of the loop.
    """

    axes: tuple[str, ...]
    capacity: int
    period_ns: int

    @classmethod
    def of(cls, config: DaemonConfig) -> Self:
        """Lay out the memory of a stage: 16 s of records, or what fits into 64 MiB."""
        fitting = RING_MAX_BYTES // record_dtype(len(config.axes)).itemsize
        capacity = min(max(round(RING_S * config.rate_hz), 64), fitting)
        return cls(tuple(config.axes), capacity, s_to_ns(1 / config.rate_hz))

    @property
    def rate_hz(self) -> float:
        """Cycles per second."""
        return NS_PER_S / self.period_ns

    def dump(self) -> bytes:
        """Write it as JSON, for the header."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def load(cls, text: bytes) -> Self:
        """Read what `dump` wrote."""
        fields = json.loads(text)
        return cls(tuple(fields["axes"]), fields["capacity"], fields["period_ns"])

    def parts(self) -> dict[str, slice]:
        """Tell the bytes of each part; each begins on a page of its own."""
        axes = len(self.axes)
        sizes = {
            "header": PAGE,
            "words": WORDS * 8,
            "report": REPORT_BYTES,
            "streams": axes * STREAM_WORDS * 8,
            "urgent": URGENT_SLOTS * (SLOT_HEADER + URGENT_BYTES),
            "requests": REQUEST_SLOTS * (SLOT_HEADER + REQUEST_BYTES),
            "answers": ANSWER_SLOTS * (SLOT_HEADER + ANSWER_BYTES),
            "learned": axes * (LEARNED_HEADER + MAX_WEIGHTS) * 8,
            "events": EVENT_SLOTS * EVENT_BYTES,
            "ring": self.capacity * record_dtype(axes).itemsize,
        }
        pages = [-(-size // PAGE) * PAGE for size in sizes.values()]
        starts = accumulate(pages, initial=0)
        return {
            name: slice(start, start + size)
            for (name, size), start in zip(sizes.items(), starts, strict=False)
        }

    @property
    def size(self) -> int:
        """Bytes of the whole."""
        end: int = self.parts()["ring"].stop
        return -(-end // PAGE) * PAGE
