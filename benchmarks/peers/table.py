"""The table of a record, and the rows that are better than piezod."""

import math
from collections.abc import Sequence
from typing import Final

from benchmarks.peers.method import Row

PIEZOD: Final = "piezod"
"""The names of the rows of piezod start with this."""
BETTER: Final = 0.9
"""An error below this share of that of the best row of piezod is marked."""
ERRORS: Final = {
    "held_out_max_pct": "held-out max",
    "held_out_rms_pct": "held-out rms",
    "test_max_pct": "test max",
    "test_rms_pct": "test rms",
}
HEADINGS: Final = ("held-out max %", "   rms %", "test max %", "   rms %", "  fit s", "µs/sample")
"""Headings of the numbers, as wide as their columns."""


def sorted_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the rows by their rms error on held-out data; rows without one come last."""
    return sorted(rows, key=lambda row: _or_infinite(row.held_out_rms_pct))


def better_than_piezod(row: Row, rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the errors of a row that are more than 10 % below those of piezod, by name.

    Piezod's best row is the one with the smallest rms error on held-out data.
    """
    ours = [each for each in sorted_rows(rows) if each.method.startswith(PIEZOD)]
    if not ours or row.method.startswith(PIEZOD):
        return ()
    return tuple(
        name
        for error, name in ERRORS.items()
        if getattr(row, error) < BETTER * getattr(ours[0], error)
    )


def table_of(rows: Sequence[Row]) -> str:
    """Return the table of a record, one line for each row."""
    width = max(len(row.method) for row in rows)
    lines = [f"{'method':{width}}  {'  '.join(HEADINGS)}  settings"]
    lines += [_line(row, rows, width) for row in sorted_rows(rows)]
    return "\n".join(lines)


def _line(row: Row, rows: Sequence[Row], width: int) -> str:
    if row.failure:
        return f"{row.method:{width}}  not measured: {row.failure}"
    errors = (getattr(row, error) for error in ERRORS)
    numbers = [*map(error_text, errors), f"{row.fit_s:.2f}", f"{row.sample_us:.2f}"]
    columns = (f"{n:>{len(heading)}}" for n, heading in zip(numbers, HEADINGS, strict=True))
    better = better_than_piezod(row, rows)
    mark = f"  <- better than piezod ({', '.join(better)})" if better else ""
    return f"{row.method:{width}}  {'  '.join(columns)}  {row.setting}{mark}"


def error_text(error_pct: float) -> str:
    """Return an error in % as the tables have it."""
    if math.isnan(error_pct):
        return "-"
    return f"{error_pct:.3f}" if error_pct < 1000.0 else "diverges"


def _or_infinite(error_pct: float) -> float:
    return math.inf if math.isnan(error_pct) else error_pct
