"""The record of a stage in a laboratory, to be written in every format."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from piezod.reading.table import FloatArray

SIZE = 400
T_S = np.arange(SIZE) / 1000.0
DRIVE_V = np.round(50.0 - 50.0 * np.cos(2.0 * np.pi * 5.0 * T_S), 4)
POSITION_UM = np.round(0.19 * DRIVE_V + 0.5 * np.sin(2.0 * np.pi * 5.0 * T_S), 4)
COLUMNS: Mapping[str, FloatArray] = {
    "t_s": T_S,
    "drive_v": DRIVE_V,
    "position_um": POSITION_UM,
}
NAMES = ("t_s", "drive_v", "position_um")


def rows(*columns: Sequence[float] | FloatArray, sep: str = ",", decimal: str = ".") -> str:
    """Return columns as lines of text."""
    lines = (
        sep.join(repr(float(value)).replace(".", decimal) for value in row)
        for row in zip(*columns, strict=True)
    )
    return "\n".join(lines) + "\n"


def record_text(header: str = ",".join(NAMES), **how: str) -> str:
    """Return the record as text, with lines above it."""
    return f"{header}\n{rows(*COLUMNS.values(), **how)}"


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    """Write a text file, and return its path."""
    path.write_bytes(text.encode(encoding))
    return path


def is_the_record(columns: Mapping[str, FloatArray]) -> bool:
    """Return whether columns are the record to the last bit, the time from any beginning."""
    since_s = columns["t_s"] - columns["t_s"][0]
    return (
        np.allclose(since_s, T_S, rtol=0.0, atol=1e-12)
        and np.array_equal(columns["drive_v"], DRIVE_V)
        and np.array_equal(columns["position_um"], POSITION_UM)
    )
