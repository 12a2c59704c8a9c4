"""Experiments: devices, axes, the identification of the model, and the cases."""

from pathlib import Path
from typing import Self

from pydantic import ValidationInfo, model_validator

from piezod.config.experiment_fields import ExperimentFields
from piezod.config.fields import Context, Drivers, context_of, raise_rules
from piezod.config.rules import broken_rules
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml


class ExperimentConfig(ExperimentFields):
    """An experiment."""

    @model_validator(mode="after")
    def _check_rules(self, info: ValidationInfo) -> Self:
        raise_rules(broken_rules(self, context_of(info).drivers))
        return self


def load_experiment(path: Path, drivers: Drivers) -> ExperimentConfig:
    """Read an experiment.

    Args:
        path: Path of the YAML file; paths in it are relative to its folder.
        drivers: Available drivers, `piezod.devices.registry`; only drivers in the file are loaded.

    Raises:
        ConfigError: If it is not a valid experiment; the text lists every problem with its place.
    """
    return validate(load_yaml(path), ExperimentConfig, Context(path.parent, drivers))
