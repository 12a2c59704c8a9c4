"""User axes in the recording of a stage: their units, and how far the stage was from its path."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.reader import RecordedTelemetry

_PATH_S: Final = 0.1
"""The stage follows its command by less than this time, in s."""
_MOST_LINES: Final = 200


def user_units(header: TelemetryHeader) -> dict[str, str]:
    """Return the units of the user axes by name; empty without user axes."""
    transform = (header.configuration() or {}).get("transform") or {}
    axes: dict[str, Any] = transform.get("axes", {})
    return {name: str(axis.get("unit", "µm")) for name, axis in axes.items() if name in header.axes}


def plane_of(header: TelemetryHeader, axis: str) -> tuple[str, ...]:
    """Return the user axes with the unit of this one; none if there are fewer than two."""
    units = user_units(header)
    found = tuple(name for name, unit in units.items() if unit == units.get(axis))
    return found if len(found) > 1 else ()


def contour_error(telemetry: RecordedTelemetry, names: Sequence[str]) -> NDArray[np.float64]:
    """Return how far the stage is from the path of its command, whatever the time, in each cycle.

    The path of a cycle are the straight lines between the commands of the time before it.

    Args:
        telemetry: The recording.
        names: User axes of one unit.

    Returns:
        (n_records,) distance in that unit; NaN if a position or a command is unknown.
    """
    command = np.stack([telemetry.axes[name]["command_um"] for name in names], axis=1)
    position = np.stack([telemetry.axes[name]["position_um"] for name in names], axis=1)
    lines = min(max(round(_PATH_S * telemetry.header.rate_hz), 1), _MOST_LINES, len(command))
    nearest: NDArray[np.float64] = np.linalg.norm(command - position, axis=1)
    for back in range(1, lines):
        begin = command[:-back]
        way = command[1 : len(command) - back + 1] - begin
        off = position[back:] - begin
        length = np.einsum("ij,ij->i", way, way)
        along = np.einsum("ij,ij->i", off, way)
        share = np.clip(along / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        apart = np.linalg.norm(off - share[:, None] * way, axis=1)
        nearest[back:] = np.fmin(nearest[back:], apart)
    nearest[~np.isfinite(command).all(axis=1)] = np.nan
    return nearest
