"""`piezod plot`: the figure of a recording, or of a model."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from piezod.cli.record_options import record_file
from piezod.cli.stage_options import SocketOption, StageOption

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(  # noqa: PLR0913, PLR0917 - each argument is an option
    recording: RecordingArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            readable=False,
            help="Figure to write, .png, .svg or .pdf; default: REC.png in the current folder.",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="DATA",
            readable=False,
            callback=record_file,
            help="Of a model file: record of the stage, whose residual is drawn.",
        ),
    ] = None,
    axis: RecordedAxisOption = None,
    begin_s: BeginOption = None,
    end_s: EndOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Draw a recording, a scan, or a model.

    Of a recording: displacement, command, error and drive voltage over time, with the states and
    modes, and marks where cycles are late or missing, samples invalid, or faults present;
    displacement over drive voltage; the errors in each mode. Of a model file (.yaml): its loops,
    and with --record the residual over the displacement, beside the errors of the model. Of a scan:
    its pictures.
    """
    # matplotlib takes long to import.
    from piezod.records.figures.style import FORMATS, save_figure
    from piezod.records.figures.telemetry import COLUMNS, telemetry_figure

    path = checked_out(out, Path(f"{recording.stem}.png"), FORMATS)
    if other := _other_figure(recording, record):
        kind, figure = other
        save_figure(path, figure)
        print_one({kind: str(recording), "figure": str(path)}, f"Figure: {path}", json=json)
        return
    with local_file(recording, stage, socket) as file:
        telemetry = read_part(file, begin_s, end_s, COLUMNS)
    name = telemetry.chosen_axis(axis)
    save_figure(path, telemetry_figure(telemetry, name))
    document = {"recording": str(recording), "axis": name, "figure": str(path)}
    print_one(document, f"Figure: {path}", json=json)


def _other_figure(file: Path, record: Path | None) -> "tuple[str, Figure] | None":
    """Return the kind and the figure of a model or a scan; None for a recording of a stage."""
    if file.suffix in (".yaml", ".yml"):
        from piezod.inverse.model_curves import model_curves
        from piezod.records.figures.model import model_figure

        return "model", model_figure(model_curves(file, record))
    if record is not None:
        raise typer.BadParameter("--record needs a model file", param_hint="'--record'")
    from piezod.records.scan_file import is_scan, read_scan

    if not is_scan(file):
        return None
    from piezod.records.figures.scan import scan_figure

    return "scan", scan_figure(read_scan(file))
