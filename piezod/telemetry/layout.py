"""What lies where in the memory that loop and supervisor share, and what a record holds.

A record is written by `struct` (a loop needs no array for it) and read as a structured array; both
descriptions are made here, side by side. Numbers are little-endian and lie without gaps that are
not named; every record is a multiple of eight bytes long, so that its sequence numbers are aligned.
"""

import json
from dataclasses import asdict, dataclass
from itertools import accumulate
from typing import Final, Self

import numpy as np

from piezod.config.daemon import DaemonConfig
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

AXIS_FIELDS: Final = (
    ("sample_ns", "<i8", "q"),
    ("position_um", "<f8", "d"),
    ("command_um", "<f8", "d"),
    ("target_um", "<f8", "d"),
    ("uncompensated_v", "<f8", "d"),
    ("asked_v", "<f8", "d"),
    ("drive_v", "<f8", "d"),
    ("in_force_v", "<f8", "d"),
    ("read_back_v", "<f8", "d"),
    ("trim_um", "<f8", "d"),
    ("mode", "u1", "B"),
    ("gate", "u1", "B"),
    ("on_target", "?", "?"),
    ("_axis_gap", "V5", "5x"),
    ("motion", "<i8", "q"),
)
"""Name, numpy's and struct's description of what is told of an axis, in the order of `append`.

`mode` is the place in `config.modes.Mode`, `gate` that in `control.law.gate.GateReason`.
"""

CYCLE_FIELDS: Final = (
    ("t_ns", "<i8", "q"),
    ("late_ns", "<i8", "q"),
    ("read_ns", "<i8", "q"),
    ("compute_ns", "<i8", "q"),
    ("write_late_ns", "<i8", "q"),
    ("write_ns", "<i8", "q"),
    ("skipped", "<i8", "q"),
    ("present_lo", "<u8", "Q"),
    ("present_hi", "<u8", "Q"),
    ("latched_lo", "<u8", "Q"),
    ("latched_hi", "<u8", "Q"),
    ("state", "u1", "B"),
    ("shadow", "?", "?"),
    ("written", "?", "?"),
    ("_cycle_gap", "V5", "5x"),
)
"""The same of a cycle, before its axes.

`late_ns`: wake-up after the deadline; `read_ns`, `compute_ns`, `write_ns`: durations of the phases;
`write_late_ns`: begin of the write after the deadline, -1 where nothing was written; `skipped`:
periods skipped since the start; `present`, `latched`: faults, the first 64 and the others; `state`:
place in `config.states.State`.
"""


def record_dtype(axes: int) -> np.dtype[np.void]:
    """Describe a record of so many axes; the axes are the field `axes`, of shape (axes,)."""
    axis = np.dtype([(name, kind) for name, kind, _ in AXIS_FIELDS])
    cycle = [(name, kind) for name, kind, _ in CYCLE_FIELDS]
    return np.dtype([("seq", "<i8"), *cycle, ("axes", axis, (axes,)), ("end_seq", "<i8")])


def body_format(axes: int) -> str:
    """Describe the same for `struct`, without the sequence numbers at both ends."""
    cycle = "".join(code for *_, code in CYCLE_FIELDS)
    return "<" + cycle + "".join(code for *_, code in AXIS_FIELDS) * axes


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
