"""`piezod export`: a recording as a table for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.output import print_one
from piezod.cli.record.recordings import (
    BeginOption,
    EndOption,
    RecordedAxisOption,
    RecordingArgument,
    checked_out,
    local_file,
    read_part,
)
from piezod.cli.stage_options import SocketOption, StageOption
from piezod.records.parquet_file import check_parquet
from piezod.records.recording.export import export_table


def export(  # noqa: PLR0913, PLR0917 - each argument is an option
    recording: RecordingArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            readable=False,
            help="File to write, .csv or .parquet; default: REC.csv in the current folder.",
        ),
    ] = None,
    axis: RecordedAxisOption = None,
    begin_s: BeginOption = None,
    end_s: EndOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Write a recording as CSV or Parquet.

    One row per cycle; the names of the columns end in their units. States, modes and faults are
    written as their names. Without --axis all axes are written; if there are several, the columns
    of an axis begin with its name. A Parquet file has units and descriptions in its metadata.
    """
    path = checked_out(out, Path(f"{recording.stem}.csv"), (".csv", ".parquet"))
    if path.suffix.lower() == ".parquet":
        check_parquet()
    with local_file(recording, stage, socket) as file:
        part = read_part(file, begin_s, end_s, columns=("t_s",))  # checks file, part and axis
        axes = part.header.axes if axis is None else (part.chosen_axis(axis),)
        rows = part.cycles["t_s"].size
        del part  # the columns of a long recording need the memory
        columns = export_table(path, file, axes, begin_s, end_s)
    found = {"recording": str(recording), "file": str(path), "rows": rows, "columns": columns}
    text = f"{path}: {rows} rows, {len(columns)} columns: {', '.join(columns)}"
    print_one(found, text, json=json)
