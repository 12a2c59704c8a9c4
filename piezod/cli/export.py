"""`piezod export`: a recording as a table for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.recordings import (
    BeginOption,
    EndOption,
    RecordedAxisOption,
    RecordingArgument,
    checked_out,
    local_file,
    read_part,
)
from piezod.cli.stage_options import SocketOption, StageOption


def export(  # noqa: PLR0913, PLR0917 - each argument is an option
    recording: RecordingArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            readable=False,
            help="File to write; default: REC.csv in the current folder.",
        ),
    ] = None,
    axis: RecordedAxisOption = None,
    begin_s: BeginOption = None,
    end_s: EndOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Write a recording as CSV.

    One row per cycle; the names of the columns end in their units. States, modes and faults are
    written as their names. Without --axis all axes are written; if there are several, the columns
    of an axis begin with its name.
    """
    from piezod.cli.output import new_console, print_json
    from piezod.records.csv_file import write_csv
    from piezod.records.telemetry_table import table_of

    path = checked_out(out, Path(f"{recording.stem}.csv"), (".csv",))
    with local_file(recording, stage, socket) as file:
        telemetry = read_part(file, begin_s, end_s)
    axes = telemetry.header.axes if axis is None else (telemetry.chosen_axis(axis),)
    table = table_of(telemetry, axes)
    write_csv(path, table)
    rows = table["t_s"].size
    if json:
        document = {"recording": str(recording), "file": str(path), "rows": rows}
        print_json({**document, "columns": list(table)})
    else:
        text = f"{path}: {rows} rows, {len(table)} columns: {', '.join(table)}"
        new_console().print(text, soft_wrap=True)
