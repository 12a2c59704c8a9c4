"""`piezod replay`: the control law again, on what was recorded."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file
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
from piezod.config.modes import Mode

if TYPE_CHECKING:
    from piezod.config.daemon import StageAxisConfig
    from piezod.control.law.model import StageModel
    from piezod.experiment.replay.comparison import Comparison
    from piezod.records.telemetry_reader import RecordedTelemetry


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
    figure = _figure_file(out) if out else None
    with local_file(recording, stage, socket) as file:
        telemetry = read_part(file, begin_s, end_s)
        name = telemetry.chosen_axis(axis)
        compared = _compared(file, telemetry, name, model, mode)
    if figure:
        _draw(figure, recording, name, compared)
    from piezod.cli.record.replay_view import as_document, print_comparison

    if json:
        from piezod.cli.output import print_json

        print_json(as_document(recording, name, model, mode, compared, figure))
    else:
        from piezod.cli.output import new_console

        print_comparison(new_console(), model, mode, compared, figure)


def _figure_file(out: Path) -> Path:
    from piezod.records.figures.style import FORMATS  # imports matplotlib, which is slow

    return checked_out(out, out, FORMATS)


def _compared(
    file: Path, telemetry: "RecordedTelemetry", axis: str, model: Path | None, mode: Mode | None
) -> "Comparison":
    config, recorded_model = _recorded_axis(file, telemetry, axis, needed=model is None)

    from piezod.control.law.model_files import read_model
    from piezod.experiment.replay.comparison import replay_recording

    used = read_model(model)[0] if model else recorded_model
    assert used is not None  # noqa: S101 - `needed` refuses a recording without a model
    return replay_recording(file, telemetry, axis, config, used, mode=mode, learned=model is None)


def _recorded_axis(
    recording: Path, telemetry: "RecordedTelemetry", axis: str, *, needed: bool
) -> tuple["StageAxisConfig", "StageModel | None"]:
    """Return configuration and model of a recorded axis, in use at the begin, from the file.

    Raises:
        DataError: If the file has no configuration, or a needed model is not in it.
    """
    from piezod.errors import DataError

    document = telemetry.header.configuration()
    drivers = [each.get("driver") for each in (document or {}).get("devices", {}).values()]
    if document is None or axis not in document.get("axes", {}) or not all(drivers):
        raise DataError(f"{recording}: the file has no configuration of the stage with axis {axis}")

    from piezod.control.law.model_files import read_model
    from piezod.daemon import accepted_config

    with TemporaryDirectory(prefix="piezod-") as folder:
        for name, each in document["axes"].items():
            each.pop("model", None)  # its path may lead to another model by now
            if text := telemetry.model_text(name):
                file = Path(folder) / f"model-{name}.yaml"
                file.write_text(text, encoding="utf-8")
                each["model"] = str(file)
            else:
                # Without a model the range of the commands is needed to be valid.
                each.setdefault("command_range_um", [0.0, 1.0])
        config = accepted_config.parsed(json.dumps(document), recording).axes[axis]
        if config.model is not None:
            return config, read_model(config.model)[0]
    if needed:
        raise DataError(f"{recording}: the model of axis {axis} is not in it; give one: --model")
    return config, None


def _draw(path: Path, recording: Path, axis: str, compared: "Comparison") -> None:
    import numpy as np

    from piezod.records.figures.replay import replay_figure
    from piezod.records.figures.style import save_figure

    replayed = compared.replay
    judged = replayed.recorded.judged
    figure = replay_figure(
        f"Replay of {recording.name} · axis {axis}",
        replayed.recorded.t_s,
        np.where(judged, replayed.recorded_error_um, np.nan),
        np.where(judged, replayed.error_um, np.nan),
        replayed.drive_difference_v,
    )
    save_figure(path, figure)
