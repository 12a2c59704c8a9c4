"""Writes models of simulated stages to files: `python -m tests.control.make_models [NAME ...]`.

Each stage is identified as in `config/experiments/beyond.yaml`. It takes minutes.
"""

import argparse
from dataclasses import asdict
from typing import Any

from piezod.config.model_file import ModelFile, dump_model
from piezod.control.law.model import StageModel
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import opened
from piezod.hysteresis import SurfaceForm
from tests.control.surface_rig import VARIANTS, model_path
from tests.experiment.beyond import experiment_of

NO_SOURCE = {"file": "config/experiments/beyond.yaml", "sha256": 64 * "0"}
NO_FIT = {"voltage_error_max_pct": 0.0, "voltage_error_rms_pct": 0.0}


def as_file(model: StageModel) -> ModelFile:
    """Return the contents of a model file for a surface."""
    assert isinstance(model.form, SurfaceForm)
    path = model.form.path
    fields: dict[str, Any] = {
        "version": 2,
        "created_at": "2026-11-26T12:00:00+00:00",
        "created_by": "tests.control.make_models",
        "method": "surface",
        "source": NO_SOURCE,
        "fit": NO_FIT,
        "drive_low_v": model.drive_v.low,
        "drive_high_v": model.drive_v.high,
        "position_low_um": model.position_um.low,
        "position_high_um": model.position_um.high,
        "delay_s": model.delay_s,
        "creep_time_constants_s": tuple(model.creep.time_constants_s.tolist()),
        "creep_weights": tuple(model.creep.weights.tolist()),
        "surface_coefficients": tuple(model.weights.tolist()),
        "surface_activation": model.form.activation,
        "surface_prompt_slope": model.form.prompt_slope,
        "surface_path": asdict(path) if path else None,
    }
    return ModelFile.model_validate(fields)


def main() -> None:
    """Identify the stages that the command line names, or all."""
    parser = argparse.ArgumentParser(prog="python -m tests.control.make_models")
    parser.add_argument("names", nargs="*", default=list(VARIANTS)[1:])
    for name in parser.parse_args().names:
        config = experiment_of(VARIANTS[name])
        with opened(config, lambda _cycles: None) as stage:
            model = identify_axes(stage, config)["x"].model
        model_path(name).write_text(dump_model(as_file(model)), encoding="utf-8")


if __name__ == "__main__":
    main()
