"""`piezod replay`: the control law again, on what was recorded."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json
from piezod.cli.paths import existing_file
from piezod.cli.record.recordings import (
    BeginOption,
    EndOption,
    RecordedAxisOption,
    RecordingArgument,
    local_file,
    read_part,
)
from piezod.cli.stage_options import SocketOption, StageOption
from piezod.config.modes import Mode


def replay(  # noqa: PLR0913, PLR0917 - each argument is an option
    recording: RecordingArgument,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL.yaml",
            readable=False,
            callback=existing_file,
            help="Model to use; default: the one that the stage used.",
        ),
    ] = None,
    mode: Annotated[
        Mode | None,
        typer.Option(help="Mode to use throughout; default: the recorded modes."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            readable=False,
            help="Draw errors and drives to this file, .png, .svg or .pdf.",
        ),
    ] = None,
    axis: RecordedAxisOption = None,
    begin_s: BeginOption = None,
    end_s: EndOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Run the control law again on a recording.

    With the same model and mode the drive must be the recorded one; the command says where it is
    not. With another model or mode it estimates the error that the stage would have had. To each
    recorded sample it adds the effect of the other voltage, by the model that describes the
    recording better: the replayed one, or stops that are fitted to the recording.
    """
    # The control law and matplotlib take long to import.
    from piezod.cli.record.replay_run import compared_in, draw, figure_file
    from piezod.cli.record.replay_view import as_document, print_comparison

    figure = figure_file(out) if out else None
    with local_file(recording, stage, socket) as file:
        telemetry = read_part(file, begin_s, end_s)
        name = telemetry.chosen_axis(axis)
        compared = compared_in(file, telemetry, name, model, mode)
    if figure:
        draw(figure, recording, name, compared)
    if json:
        print_json(as_document(recording, name, model, mode, compared, figure))
    else:
        print_comparison(new_console(), model, mode, compared, figure)
