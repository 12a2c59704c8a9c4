"""Whether a file that a person wrote can be used, whatever kind of file it is."""

from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.config.yaml_loader import load_yaml
from piezod.control.gains import check_known
from piezod.control.model_files import read_model
from piezod.devices import registry
from piezod.errors import ConfigError, ModelError, Problem


class Kind(StrEnum):
    """What a file is."""

    EXPERIMENT = "experiment"
    MODEL = "model"


class Checked(NamedTuple):
    """What a file is, and what is wrong with it.

    Attributes:
        kind: What it is, None where its content does not tell.
        contents: What is in it, for people; empty where something is wrong.
        error: All that is wrong, None for a file that can be used.
    """

    kind: Kind | None
    contents: str
    error: ConfigError | None


def check_file(path: Path) -> Checked:
    """Tell a file's kind from its keys, and validate it with the files that it names."""
    kind = None
    try:
        kind = _kind(path)
        contents = _describe_model(path) if kind is Kind.MODEL else _describe_experiment(path)
    except ConfigError as error:
        return Checked(kind, "", error)
    return Checked(kind, contents, None)


def _kind(path: Path) -> Kind:
    keys = load_yaml(path).data.keys()
    of_experiment = len(keys & ExperimentConfig.model_fields.keys())
    of_model = len(keys & ModelFile.model_fields.keys())
    if of_experiment == of_model:
        what = (
            "neither an experiment nor a model; allowed are experiments, with keys such as "
            "`devices`, `axes`, `cases`, and models, with keys such as `format`, `method`, `fit`"
        )
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    return Kind.EXPERIMENT if of_experiment > of_model else Kind.MODEL


def _describe_experiment(path: Path) -> str:
    config = load_experiment(path, registry)
    try:
        check_known(config.axes, 1.0 / config.rate_hz, trimmed=Mode.TRIMMED in config.modes)
    except ModelError as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error
    cases, modes = _count(len(config.cases), "case"), _count(len(config.modes), "mode")
    axes = _count(len(config.axes), "axis", "axes")
    return f"an experiment: {cases} in {modes} on {axes}"


def _describe_model(path: Path) -> str:
    _, file = read_model(path)
    operators = _count(len(file.right_stop_thresholds), "operator")
    return f"a model: {operators} on each side, by {file.method}"


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"
