"""A recording as a file of a table, of any length: it is read and written in portions."""

from collections.abc import Iterable, Iterator
from math import inf
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from piezod.records.csv_file import write_csv_portions
from piezod.records.nexus import unit_of
from piezod.records.parquet_file import write_parquet
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.marks import faults_latched, faults_present, names_of
from piezod.records.recording.reader import RecordedTelemetry, read_portions
from piezod.records.recording.user_axes import user_units
from piezod.units import to_ascii

Table = dict[str, NDArray[Any]]


def export_table(
    path: Path,
    recording: Path,
    axes: Iterable[str],
    begin_s: float | None = None,
    end_s: float | None = None,
) -> list[str]:
    """Write a recording, or a part of it, as CSV or Parquet; return the names of the columns.

    Args:
        path: File to write; its ending, .csv or .parquet, decides the format.
        recording: The recording.
        axes: Names of the axes.
        begin_s: Start of the part, in s; None for that of the recording.
        end_s: End of the part, exclusive, in s; None for that of the recording.

    Raises:
        DataError: If the file is not a recording of a stage.
        OSError: If a file cannot be read or written.
    """
    chosen = tuple(axes)
    begin, end = -inf if begin_s is None else begin_s, inf if end_s is None else end_s
    portions = read_portions(recording, begin, end)
    first = next(portions)
    table, header = table_of(first, chosen), first.header

    def tables() -> Iterator[Table]:
        yield table
        for portion in portions:
            yield table_of(portion, chosen)

    if path.suffix.lower() == ".parquet":
        about = {name: _about(name, header, chosen) for name in table}
        write_parquet(path, tables(), about, _metadata(header))
    else:
        write_csv_portions(path, tables())
    return list(table)


def _about(column: str, header: TelemetryHeader, axes: tuple[str, ...]) -> dict[str, str]:
    """Return unit and description of a column, whose name may begin with that of an axis."""
    names = (column, *(column.removeprefix(f"{axis}_") for axis in axes))
    found = [header.descriptions[name] for name in names if name in header.descriptions]
    units = unit_of(column)
    for axis, unit in user_units(header).items():
        if units == "um" and (column.startswith(f"{axis}_") or axes == (axis,)):
            units = to_ascii(unit)
    return {"units": units, "description": found[0] if found else ""}


def _metadata(header: TelemetryHeader) -> dict[str, str]:
    plain = {
        "title": header.title,
        "started_at": header.started_at,
        "start_ns": str(header.start_ns),
        "rate_hz": str(header.rate_hz),
    }
    return {f"piezod.{name}": text for name, text in (plain | dict(header.notes)).items()}


def table_of(telemetry: RecordedTelemetry, axes: Iterable[str]) -> Table:
    """Return the columns by name, with names in place of numbers; each of shape (n_records,).

    The names of the columns end in their units. The columns of an axis have its name before theirs
    if the table has several axes.
    """
    chosen = tuple(axes)
    table: Table = {"t_s": telemetry.cycles["t_s"]}
    for axis in chosen:
        prefix = f"{axis}_" if len(chosen) > 1 else ""
        columns = telemetry.axes[axis]
        table |= {prefix + name: column for name, column in _columns(telemetry, columns)}
    table |= dict(_columns(telemetry, telemetry.cycles))
    faults = {"faults_present": faults_present, "faults_latched": faults_latched}
    return table | {name: of(telemetry) for name, of in faults.items()}


def _columns(telemetry: RecordedTelemetry, columns: Table) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, column in columns.items():
        if name in telemetry.header.names:
            yield name, names_of(telemetry, name, column)
        elif name != "t_s" and name not in telemetry.header.bits:
            yield name, column
