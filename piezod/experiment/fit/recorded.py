"""Drive and displacement of an axis, from the recording of a running stage.

The deadlines of the loop are evenly spaced, so the record is put on them. Skipped cycles and
invalid samples are filled in by straight lines if there are few in a row.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezod.config.states import State
from piezod.config.yaml_loader import parse_yaml
from piezod.errors import DataError, LatenessError
from piezod.experiment.fit.record import Rows
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry

MAX_FILLED: Final = 5
"""This many samples in a row may be filled in at any rate."""
MAX_FILLED_S: Final = 0.05
"""At fast rates as many as this time contains, in s."""
_LONGEST_DELAY_S: Final = 10.0
MAX_MISSING_SHARE: Final = 0.02
"""Largest share of the samples that may be filled in."""
_DRIVEN: Final = (State.READY, State.RUN, State.IDENT, State.HOLD, State.RAMP)
"""States in which the voltage in force is known."""

Columns = dict[str, FloatArray]
Placing = Callable[[RecordedTelemetry, str, Rows], tuple[Columns, int]]
"""Makes a record even in time; also returns how many samples were filled in."""


def columns_of_recording(
    path: Path, axis: str | None, placed: Placing | None = None
) -> tuple[Columns, tuple[str, ...]]:
    """Return the record in a recording, evenly in time, and what to know about it.

    It is the longest part in which the stage is armed and no gap is too long to be filled in.

    Args:
        path: The recording.
        axis: Name of the axis; None for the only one.
        placed: Function that makes the record even in time; None for `on_deadlines`.

    Raises:
        DataError: If the file is no recording, or has no usable part of this axis.
        OSError: If the file cannot be read.
    """
    telemetry = read_telemetry(path)
    name = telemetry.chosen_axis(axis)
    names = telemetry.header.names["state"]
    known = [number for number, state in enumerate(names) if state in _DRIVEN]
    driven = np.isin(telemetry.cycles["state"], known)
    driven &= np.isfinite(telemetry.axes[name]["in_force_v"])
    if not driven.any():
        raise DataError(f"{path}: the stage is never armed in this recording; record a movement")
    part, notes = _longest_part(telemetry, name, driven)
    columns, missing = (placed or on_deadlines)(telemetry, name, part)
    samples = columns["t_s"].size
    check_missing(f"{path}: axis {name}", missing, samples - int(part.sum()), samples)
    if np.ptp(columns["drive_v"]) == 0.0:
        raise DataError(f"{path}: the voltage of axis {name} is constant; record a movement")
    return columns, (*notes, *told_missing(missing, columns["t_s"].size))


def delay_of_recording(path: Path, axis: str | None) -> float | None:
    """Return the delay of the model that a recorded axis used, in s; None if it is not known."""
    telemetry = read_telemetry(path, 0.0, 0.0)  # the header only
    note = telemetry.header.notes.get(f"model_{telemetry.chosen_axis(axis)}")
    if note is None:
        return None
    delay_s = parse_yaml(note, f"{path}: its model").data.get("delay_s")
    if not isinstance(delay_s, float | int) or not 0.0 <= delay_s <= _LONGEST_DELAY_S:
        what = f"the delay of the model in it is {delay_s!r}"
        raise DataError(f"{path}: {what}; allowed: 0 to {_LONGEST_DELAY_S:g} s; give --delay-s")
    return float(delay_s)


def on_deadlines(
    telemetry: RecordedTelemetry, axis: str, rows: Rows
) -> tuple[dict[str, FloatArray], int]:
    """Return the record on the deadlines of the loop, and how many samples were filled in.

    Args:
        telemetry: The recording.
        axis: Name of the axis.
        rows: (n_records,) records to use, at least two.
    """
    t_s = telemetry.cycles["t_s"][rows]
    due_s, places = _deadlines(telemetry, rows)
    even_s = np.arange(places[-1] + 1) / telemetry.header.rate_hz
    position_um = telemetry.axes[axis]["position_um"][rows]
    valid = np.isfinite(position_um)
    since_s = t_s - due_s[0]
    columns = {
        "t_s": even_s,
        "drive_v": np.interp(even_s, since_s, telemetry.axes[axis]["in_force_v"][rows]),
        "position_um": np.interp(even_s, since_s[valid], position_um[valid]),
    }
    return columns, int(even_s.size - np.count_nonzero(valid))


def on_cycles(
    telemetry: RecordedTelemetry, axis: str, rows: Rows
) -> tuple[dict[str, FloatArray], int]:
    """Return the record by the numbers of its cycles, and how many samples were filled in.

    No sample is moved to its deadline by a straight line, which would smooth fast changes. The
    instants are wrong by the lateness of the loop instead.

    Args:
        telemetry: The recording.
        axis: Name of the axis.
        rows: (n_records,) records to use, at least two.
    """
    _, places = _deadlines(telemetry, rows)
    even = np.arange(places[-1] + 1)
    position_um = telemetry.axes[axis]["position_um"][rows]
    valid = np.isfinite(position_um)
    # In a skipped cycle nothing was written: the voltage of the next record was in force already.
    following = np.searchsorted(places, even)
    columns = {
        "t_s": even / telemetry.header.rate_hz,
        "drive_v": telemetry.axes[axis]["in_force_v"][rows][following],
        "position_um": np.interp(even, places[valid], position_um[valid]),
    }
    return columns, int(even.size - np.count_nonzero(valid))


def check_missing(what: str, missing: int, skipped: int, samples: int) -> None:
    """Refuse a record of which too much is filled in.

    Raises:
        LatenessError: If more than `MAX_MISSING_SHARE` was skipped.
        DataError: If more than `MAX_MISSING_SHARE` is missing.
    """
    allowed = f"of {samples} samples are missing, allowed are {100 * MAX_MISSING_SHARE:g} %"
    if skipped > MAX_MISSING_SHARE * samples:
        raise LatenessError(
            f"{what}: {missing} {allowed}: the computer was late, and the loop skipped {skipped} "
            "cycles; end other programs, give the loop a processor and real-time priority, or "
            "lower rate_hz"
        )
    if missing > MAX_MISSING_SHARE * samples:
        raise DataError(
            f"{what}: {missing} {allowed}: the sensor gave no valid sample; check its range, "
            "cable and alignment"
        )


def told_missing(
    missing: int, samples: int, why: str = "they were skipped by the loop or invalid"
) -> tuple[str, ...]:
    """Return the warning about samples that were filled in, if there are any."""
    if not missing:
        return ()
    return (
        f"{missing} of {samples} samples were missing, because {why}: they were filled in by "
        "straight lines.",
    )


def _deadlines(telemetry: RecordedTelemetry, rows: Rows) -> tuple[FloatArray, NDArray[np.float64]]:
    """Return the deadlines of records in s, and their numbers since the first."""
    # The deadlines are evenly spaced; the wake-ups after them are not.
    due_s = telemetry.cycles["t_s"][rows] - 1e-9 * telemetry.cycles["late_ns"][rows]
    return due_s, np.rint((due_s - due_s[0]) * telemetry.header.rate_hz)


def _longest_part(
    telemetry: RecordedTelemetry, axis: str, rows: Rows
) -> tuple[Rows, tuple[str, ...]]:
    """Return the records of the longest part without a long gap, and what was left out."""
    usable = np.flatnonzero(rows & np.isfinite(telemetry.axes[axis]["position_um"]))
    if usable.size < 2:
        raise DataError(f"axis {axis}: the recording has no valid sample while the stage is armed")
    chosen = np.zeros_like(rows)
    chosen[usable] = True
    due_s, places = _deadlines(telemetry, chosen)
    longest = max(MAX_FILLED, round(MAX_FILLED_S * telemetry.header.rate_hz))
    breaks = np.flatnonzero(np.diff(places) > longest + 1) + 1
    begins, ends = np.concatenate(([0], breaks)), np.concatenate((breaks, [usable.size]))
    best = int(np.argmax(places[ends - 1] - places[begins]))
    first, last = int(begins[best]), int(ends[best]) - 1
    within = np.zeros_like(rows)
    within[usable[first] : usable[last] + 1] = True
    if not breaks.size:
        return rows & within, ()
    gap = int(np.argmax(np.diff(places)))
    return rows & within, (
        f"The recording has {breaks.size} gaps of more than {longest} samples in which the stage "
        f"was not armed or samples are missing, the longest of {due_s[gap + 1] - due_s[gap]:.3g} s "
        f"at {due_s[gap]:.5g} s. The longest part without one is used, from {due_s[first]:.5g} to "
        f"{due_s[last]:.5g} s.",
    )
