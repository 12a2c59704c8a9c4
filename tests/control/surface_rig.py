"""The simulated stage with a model of each class: stops, and surfaces with each of their terms."""

from functools import cache
from pathlib import Path
from typing import Final

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.model_file import ModelFile, load_model
from tests.control.rig_stage import CONFIG

MODELS: Final = Path(__file__).parent / "models"
VARIANTS: Final = {
    "stops": "stack",
    "surface": "stack",
    "lag": "thermal-relays",
    "path": "bouc-wen",
}
"""Variant of the simulated rig for each model: the stops that are shipped, a plain surface, a
surface with a lag that grows with the rate, and one with a part that relaxes along the path."""
CLASSES: Final = ["stops", "surface"]
"""One model of each class, as parameters of a test."""
EACH_MODEL: Final = [
    *CLASSES,
    *(pytest.param(name, marks=pytest.mark.stress) for name in ("lag", "path")),
]
"""All models, likewise; those with a term of their own are for `make stress`."""


def model_path(model: str) -> Path:
    """Return the model file; `make_models` writes those of surfaces."""
    shipped = CONFIG.parent / "models" / "simulated-stack.yaml"
    return shipped if model == "stops" else MODELS / f"{model}.yaml"


@cache
def surface_file() -> ModelFile:
    """Return the contents of the file of the plain surface."""
    return load_model(model_path("surface"))


def with_model(config: DaemonConfig, model: str) -> DaemonConfig:
    """Return a configuration of one stage with another model, and the stage that it describes."""
    axis = config.axes["x"].model_copy(update={"model": model_path(model)})
    rig = config.devices["rig"]
    options = type(rig.options).model_validate({"variant": VARIANTS[model]})
    devices = {"rig": rig.model_copy(update={"options": options})}
    return config.model_copy(update={"axes": {"x": axis}, "devices": devices})
