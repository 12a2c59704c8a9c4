"""Writes models of simulated stages to files: `python -m tests.control.make_models [NAME ...]`.

Each stage is identified as in `config/experiments/beyond.yaml`. It takes minutes.
"""

import argparse

from piezod.config.model_file import FitConfig, ModelFile, SourceConfig, dump_model
from piezod.control.law.model import StageModel
from piezod.experiment.fit.model_io import model_fields
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import opened
from tests.control.surface_rig import VARIANTS, model_path
from tests.experiment.beyond import experiment_of


def as_file(model: StageModel) -> ModelFile:
    """Return the contents of a model file for a surface."""
    return ModelFile(
        created_at="2026-11-26T12:00:00+00:00",
        created_by="tests.control.make_models",
        method="surface",
        source=SourceConfig(file="config/experiments/beyond.yaml", sha256=64 * "0"),
        fit=FitConfig(voltage_error_max_pct=0.0, voltage_error_rms_pct=0.0),
        **model_fields(model),
    )


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
