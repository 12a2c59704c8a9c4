"""Arguments and options of the commands that read a recording, and their checks."""

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, TypeAlias

import typer

from piezod.cli.output import error_console
from piezod.cli.paths import check_writable, existing_file
from piezod.cli.stage_options import connect
from piezod.client import StageClient
from piezod.errors import DataError
from piezod.reading.hdf5_magic import is_hdf5
from piezod.records.recording.part_names import RECORDING_NAME, without_part
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry


def _file_or_name(recording: Path) -> Path:
    """Return the argument unchanged, if it is a file or may be the name of a recording.

    Raises:
        typer.BadParameter: If it is neither.
        OSError: If the permission to look at the file is missing.
    """
    if not RECORDING_NAME.fullmatch(str(recording)) or recording.exists():
        existing_file(recording)
    return recording


RecordingArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="REC",
        help="Recording: a file, as `piezod record get` copies it, or the name of one in "
        "`piezod record list` of a running stage; a file of a flight record too.",
        readable=False,
        callback=_file_or_name,
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


@contextmanager
def local_file(recording: Path, stage: str | None, socket: Path | None) -> Iterator[Path]:
    """Yield the file of a recording: itself, or a copy of that of a running stage.

    Raises:
        ClientError: If the stage does not run, or has no finished recording of that name.
        OSError: If it cannot be copied.
    """
    if recording.exists():
        yield recording
        return
    with TemporaryDirectory(prefix="piezod-") as folder:
        file = Path(folder) / f"{recording.name}.h5"
        with connect(stage, socket) as client:
            client.fetch_recording(recording.name, file)
            _report_further_files(recording.name, client)
        yield file


def _report_further_files(name: str, client: StageClient) -> None:
    """Print to stderr if a recording has further files, because only one is used."""
    names = sorted(each.name for each in client.recordings().recordings)
    if found := [each for each in names if each != name and without_part(each) == name]:
        last = f" to {found[-1]}" if len(found) > 1 else ""
        text = f"{name} is the first file of the recording; it goes on in {found[0]}{last}"
        error_console().print(text, soft_wrap=True)


def read_part(
    file: Path,
    begin_s: float | None,
    end_s: float | None,
    columns: Collection[str] | None = None,
) -> RecordedTelemetry:
    """Return a recording, or the part of it between two instants.

    Args:
        file: The file.
        begin_s: Start of the part, in s; None for that of the recording.
        end_s: End of the part, in s; None for that of the recording.
        columns: Names of the columns to read; all if None.

    Raises:
        DataError: If the file is not a recording, or has no record in that part.
        OSError: If the file cannot be read.
    """
    if not is_hdf5(file):
        raise DataError(f"{file}: this is not an HDF5 file; needed is one of `piezod record get`")
    begin, end = -inf if begin_s is None else begin_s, inf if end_s is None else end_s
    telemetry = read_telemetry(file, begin, end, columns)
    if not telemetry.cycles["t_s"].size:
        raise DataError(f"{file}: no cycle is recorded in this part; choose another one")
    return telemetry


def checked_out(
    out: Path | None, default: Path, endings: Iterable[str], source: Path | None = None
) -> Path:
    """Return the path of the output, after a check that it can be written.

    Args:
        out: The given path; None for the default.
        default: Path to write if none is given.
        endings: Allowed endings.
        source: The file that is read, which stays.

    Raises:
        typer.BadParameter: If the ending is not allowed, or the output would replace the source.
        OSError: If the folder is not writable.
    """
    path, allowed = out or default, tuple(endings)
    if path.suffix.lower() not in allowed:
        message = f"must end in {' or '.join(allowed)} (got {path})"
        raise typer.BadParameter(message, param_hint="'--out'")
    if source is not None and path.exists() and source.exists() and path.samefile(source):
        message = f"must be another file than {source}, which is read and stays"
        raise typer.BadParameter(message, param_hint="'--out'")
    if path.parent.is_dir():
        check_writable(path.parent)
    return path
