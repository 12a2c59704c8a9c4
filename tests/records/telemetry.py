"""Synthetic records of a running stage, and a header for them."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezod.records.recording.header import TelemetryHeader

RATE_HZ: Final = 1000.0
MODES: Final = ("uncompensated", "feedforward", "adaptive")
START_NS: Final = 5_000_000_000

AXIS: Final = np.dtype(
    [
        ("sample_ns", "<i8"),
        ("position_um", "<f8"),
        ("command_um", "<f8"),
        ("uncompensated_v", "<f8"),
        ("drive_v", "<f8"),
        ("mode", "u1"),
        ("on_target", "?"),
        ("_gap", "V6"),
    ]
)
"""Some of the fields of an axis; the file takes whatever there is."""


def record_dtype(axes: int = 1) -> np.dtype[np.void]:
    """Return a dtype like that of the telemetry, with fewer fields."""
    cycle = [("seq", "<i8"), ("t_ns", "<i8"), ("late_ns", "<i8"), ("lines", "<i8")]
    cycle += [("state", "u1"), ("_gap", "V7")]
    return np.dtype([*cycle, ("axes", AXIS, (axes,)), ("end_seq", "<i8")])


def records(begin: int, end: int, axes: int = 1, mode: int = 1) -> NDArray[Any]:
    """Return the records of some cycles, each with its own position."""
    made = np.zeros(end - begin, record_dtype(axes))
    number = np.arange(begin, end)
    made["seq"] = made["end_seq"] = number
    made["t_ns"] = START_NS + number * round(1e9 / RATE_HZ)
    made["state"] = number % 2
    for axis in range(axes):
        columns = made["axes"][:, axis]
        columns["position_um"] = number / 7 + 1000 * axis
        columns["command_um"], columns["drive_v"] = number / 7, np.sin(number)
        columns["mode"] = mode
    return made


def header(
    axes: tuple[str, ...] = ("x",), notes: Mapping[str, str] | None = None
) -> TelemetryHeader:
    """Return the header of such a recording."""
    return TelemetryHeader(
        title="made up, µm",
        axes=axes,
        rate_hz=RATE_HZ,
        started_at="2024-05-01T12:00:00+00:00",
        start_ns=START_NS,
        names={"state": ("SAFE", "RUN"), "mode": MODES},
        notes=notes or {},
        descriptions={"late_ns": "Wake-up after the deadline.", "drive_v": "Written voltage."},
        bits={"seq": ("S1", "A2")},
    )
