"""Arguments and options of the commands that read a recording, and their checks."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from piezod.cli.paths import check_writable, existing_file

if TYPE_CHECKING:
    from piezod.records.telemetry_reader import RecordedTelemetry

RecordingArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="REC.h5",
        help="Recording, as `piezod record get` copies it; a flight record too.",
        readable=False,
        callback=existing_file,
    ),
]
RecordedAxisOption: TypeAlias = Annotated[
    str | None, typer.Option("--axis", metavar="NAME", help="Axis; default: the only one.")
]
BeginOption: TypeAlias = Annotated[
    float | None, typer.Option("--begin-s", metavar="S", help="Start of the part to use, in s.")
]
EndOption: TypeAlias = Annotated[
    float | None, typer.Option("--end-s", metavar="S", help="End of the part to use, in s.")
]


def read_part(file: Path, begin_s: float | None, end_s: float | None) -> "RecordedTelemetry":
    """Return a recording, or the part of it between two instants.

    Raises:
        DataError: If the file is not a recording, or has no record in that part.
        OSError: If the file cannot be read.
    """
    from math import inf

    from piezod.errors import DataError
    from piezod.records.telemetry_reader import is_hdf5, read_telemetry

    if not is_hdf5(file):
        raise DataError(f"{file}: this is not an HDF5 file; needed is one of `piezod record get`")
    begin, end = -inf if begin_s is None else begin_s, inf if end_s is None else end_s
    telemetry = read_telemetry(file, begin, end)
    if not telemetry.cycles["t_s"].size:
        raise DataError(f"{file}: no cycle is recorded in this part; choose another one")
    return telemetry


def checked_out(out: Path | None, default: Path, endings: Iterable[str]) -> Path:
    """Return the path of the output, after a check that it can be written.

    Args:
        out: The given path; None for the default.
        default: Path to write if none is given.
        endings: Allowed endings.

    Raises:
        typer.BadParameter: If the ending is not allowed.
        OSError: If the folder is not writable.
    """
    path, allowed = out or default, tuple(endings)
    if path.suffix.lower() not in allowed:
        message = f"must end in {' or '.join(allowed)} (got {path})"
        raise typer.BadParameter(message, param_hint="'--out'")
    if path.parent.is_dir():
        check_writable(path.parent)
    return path
