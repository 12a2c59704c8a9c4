"""A recording as one table with a column for each quantity, for other programs."""

from collections.abc import Iterable, Iterator
from typing import Any

from numpy.typing import NDArray

from piezod.records.telemetry_marks import faults_latched, faults_present, names_of
from piezod.records.telemetry_reader import RecordedTelemetry


def table_of(telemetry: RecordedTelemetry, axes: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Return the columns by name, with names in place of numbers; each of shape (n_records,).

    The names of the columns end in their units. The columns of an axis have its name before theirs
    if the table has several axes.

    Args:
        telemetry: The recording.
        axes: Names of the axes.
    """
    chosen = tuple(axes)
    table: dict[str, NDArray[Any]] = {"t_s": telemetry.cycles["t_s"]}
    for axis in chosen:
        prefix = f"{axis}_" if len(chosen) > 1 else ""
        columns = telemetry.axes[axis]
        table |= {prefix + name: column for name, column in _columns(telemetry, columns)}
    table |= dict(_columns(telemetry, telemetry.cycles))
    faults = {"faults_present": faults_present, "faults_latched": faults_latched}
    return table | {name: of(telemetry) for name, of in faults.items()}


def _columns(
    telemetry: RecordedTelemetry, columns: dict[str, NDArray[Any]]
) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, column in columns.items():
        if name in telemetry.header.names:
            yield name, names_of(telemetry, name, column)
        elif name != "t_s" and name not in telemetry.header.bits:
            yield name, column
