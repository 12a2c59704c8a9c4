"""The work of `piezod replay`."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from piezod.cli.record.recordings import checked_out
from piezod.config.daemon import StageAxisConfig
from piezod.config.modes import Mode
from piezod.control.law.model import StageModel
from piezod.control.law.model_files import read_model
from piezod.daemon import accepted_config
from piezod.errors import DataError
from piezod.experiment.replay.comparison import Comparison, replay_recording
from piezod.records.recording.reader import RecordedTelemetry


def figure_file(out: Path) -> Path:
    """Return the path of the figure, after a check that it can be written."""
    from piezod.records.figures.style import FORMATS  # imports matplotlib, which is slow

    return checked_out(out, out, FORMATS)


def compared_in(
    file: Path, telemetry: RecordedTelemetry, axis: str, model: Path | None, mode: Mode | None
) -> Comparison:
    """Replay a recording; model and mode that are not given are the recorded ones.

    Raises:
        DataError: If the file does not have what the replay needs.
    """
    config, recorded_model = _recorded_axis(file, telemetry, axis, needed=model is None)

    used = read_model(model)[0] if model else recorded_model
    assert used is not None  # noqa: S101 - `needed` refuses a recording without a model
    return replay_recording(file, telemetry, axis, config, used, mode=mode, learned=model is None)


def _recorded_axis(
    recording: Path, telemetry: RecordedTelemetry, axis: str, *, needed: bool
) -> tuple[StageAxisConfig, StageModel | None]:
    """Return configuration and model of a recorded axis, in use at the begin, from the file.

    Raises:
        DataError: If the file has no configuration, or a needed model is not in it.
    """
    document = telemetry.header.configuration()
    drivers = [each.get("driver") for each in (document or {}).get("devices", {}).values()]
    if document is None or axis not in document.get("axes", {}) or not all(drivers):
        raise DataError(f"{recording}: the file has no configuration of the stage with axis {axis}")

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


def draw(path: Path, recording: Path, axis: str, compared: Comparison) -> None:
    """Write the figure of errors and drives."""
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
