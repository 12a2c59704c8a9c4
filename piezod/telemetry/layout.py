"""Layout of the shared memory of loop and supervisor, and of the records in it.

A record is written by `struct`, because the loop needs no array for it. It is read by `struct` too,
or as a structured array (`arrays`). Both descriptions derive from `telemetry.record`. Numbers are
little-endian. Each record is a multiple of eight bytes long, so that its sequence numbers are
aligned.
"""

import json
from dataclasses import asdict, dataclass
from enum import Enum
from itertools import accumulate
from math import isfinite
from struct import calcsize
from typing import Any, Final, NamedTuple, Self, get_type_hints

from piezod.config.daemon import DaemonConfig
from piezod.telemetry.record import AxisRecord, CycleHeader
from piezod.units import NS_PER_S, s_to_ns

PAGE: Final = 4096
WORDS: Final = 64
"""Number of words of eight bytes for `words.Word`."""
REPORT_BYTES: Final = 16 * 1024
STREAM_WORDS: Final = 8
"""Words per axis in the setpoint stream: one cache line."""
URGENT_SLOTS: Final = 4
URGENT_BYTES: Final = 1024
REQUEST_SLOTS: Final = 16
REQUEST_BYTES: Final = 256 * 1024
SLOT_HEADER: Final = 64
"""Bytes before the payload of a request or an answer."""
ANSWER_SLOTS: Final = 64
ANSWER_BYTES: Final = 512
MAX_WEIGHTS: Final = 2048
LEARNED_HEADER: Final = 16
"""Words before the weights of an axis."""
BUCKETS: Final = 22
"""Buckets of a histogram: 1 µs, 2 µs, 4 µs … 1 s and above; of an error 1 nm … 1 mm and above."""
COUNTS_WORDS: Final = 64
"""Words of `cycle_counts` before the histograms of the axes."""
ERROR_WORDS: Final = 32
"""Words of the histogram of an axis."""
DEVICE_WORDS: Final = 64
"""Words per device: see `device_counts`."""
EVENT_SLOTS: Final = 512
EVENT_BYTES: Final = 512
RING_S: Final = 16.0
"""Length of the ring, in s: 10 s for the flight recorder, and time to fetch them."""
RING_MAX_BYTES: Final = 80 * 1024 * 1024

_CODES: Final = {int: ("<i8", "q"), float: ("<f8", "d"), bool: ("?", "?")}
"""Type of a field: its description for numpy and for `struct`."""
_MASK: Final = ("<u8", "Q")
_INDEX: Final = ("u1", "B")
"""A member of an enumeration is stored as its index."""


class Field(NamedTuple):
    """One field of a record in memory."""

    name: str  #: Name of the field; a gap has a name that starts with "_".
    dtype: str  #: Its description for numpy.
    code: str  #: Its description for `struct`.


def fields_of(record: type[AxisRecord] | type[CycleHeader]) -> tuple[Field, ...]:
    """Return the fields of a record in memory, from its declaration.

    Gaps align fields of eight bytes, and the end, to multiples of eight.
    """
    fields: list[Field] = []
    at = 0
    for name, kind in get_type_hints(record).items():
        dtype, code = _description(name, kind)
        size = calcsize(f"<{code}")
        # A gap before the field aligns it.
        if at % size:
            fields.append(_gap(len(fields), -at % size))
            at += -at % size
        fields.append(Field(name, dtype, code))
        at += size
    if at % 8:
        fields.append(_gap(len(fields), -at % 8))
    return tuple(fields)


def _description(name: str, kind: type) -> tuple[str, str]:
    if name.endswith(("_lo", "_hi")):
        return _MASK
    return _INDEX if issubclass(kind, Enum) else _CODES[kind]


def _gap(place: int, size: int) -> Field:
    return Field(f"_gap{place}", f"V{size}", f"{size}x")


CYCLE_FIELDS: Final = fields_of(CycleHeader)
AXIS_FIELDS: Final = fields_of(AxisRecord)


def body_format(axes: int) -> str:
    """Return the format of a record for `struct`, without the sequence numbers at both ends."""
    cycle = "".join(field.code for field in CYCLE_FIELDS)
    return "<" + cycle + "".join(field.code for field in AXIS_FIELDS) * axes


def record_bytes(axes: int) -> int:
    """Return the size of a record, in bytes, with the sequence numbers at both ends."""
    return 8 + calcsize(body_format(axes)) + 8


def enumerations() -> dict[str, tuple[Enum, ...]]:
    """Return the fields that contain an index of an enumeration, each with the members."""
    hints = get_type_hints(CycleHeader) | get_type_hints(AxisRecord)
    return {name: tuple(kind) for name, kind in hints.items() if issubclass(kind, Enum)}


_WORDS: Final = {name: [str(each.value) for each in kind] for name, kind in enumerations().items()}


def as_shown(name: str, value: Any) -> Any:
    """Return the value of a field as answers have it: the word of a member, None in place of NaN.

    Args:
        name: Name of the field.
        value: Its value as Python's own type, or the index of a member.
    """
    if name in _WORDS:
        return _WORDS[name][value]
    return value if not isinstance(value, float) or isfinite(value) else None


@dataclass(frozen=True, slots=True)
class Layout:
    """Sizes of the shared memory of a stage."""

    axes: tuple[str, ...]  #: Names of the axes, in order.
    capacity: int  #: Number of records in the ring.
    period_ns: int  #: Period of the loop, in ns.
    devices: tuple[str, ...] = ()  #: Names of the devices, in order.
    users: int = 0  #: Number of the last axes that are user axes, which learn nothing.

    @classmethod
    def of(cls, config: DaemonConfig) -> Self:
        """Return the layout for a stage: 16 s of records, or as many as fit into 80 MiB."""
        # The 80 MiB bind only for fast loops with many axes.
        axes = config.shown_axes
        fitting = RING_MAX_BYTES // record_bytes(len(axes))
        capacity = min(max(round(RING_S * config.rate_hz), 64), fitting)
        period_ns = s_to_ns(1 / config.rate_hz)
        return cls(axes, capacity, period_ns, tuple(config.devices), len(config.user_axes))

    @property
    def rate_hz(self) -> float:
        """Cycles per second."""
        return NS_PER_S / self.period_ns

    def dump(self) -> bytes:
        """Return the layout as JSON, for the header."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def load(cls, text: bytes) -> Self:
        """Return the layout that `dump` wrote."""
        fields = json.loads(text)
        return cls(
            tuple(fields["axes"]),
            fields["capacity"],
            fields["period_ns"],
            tuple(fields["devices"]),
            fields["users"],
        )

    def parts(self) -> dict[str, slice]:
        """Return the bytes of each part; each part starts on a page of its own."""
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
            "counts": (COUNTS_WORDS + axes * ERROR_WORDS) * 8,
            "devices": len(self.devices) * DEVICE_WORDS * 8,
            "events": EVENT_SLOTS * EVENT_BYTES,
            "ring": self.capacity * record_bytes(axes),
        }
        # Rounded up to whole pages.
        pages = [-(-size // PAGE) * PAGE for size in sizes.values()]
        starts = accumulate(pages, initial=0)
        return {
            name: slice(start, start + size)
            for (name, size), start in zip(sizes.items(), starts, strict=False)
        }

    @property
    def size(self) -> int:
        """Size of the whole, in bytes."""
        end: int = self.parts()["ring"].stop
        return -(-end // PAGE) * PAGE
