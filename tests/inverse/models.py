"""Models of each class, with and without creep, and signals for them."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from piezod.config.model_file import ModelFile, load_model
from piezod.control.law.model_files import from_model_file
from piezod.hysteresis.memory import FloatArray
from piezod.inverse.loaded_model import LoadedModel
from tests.control.surface_rig import model_path

RATE_HZ: Final = 1000.0
CREEPING: Final = {
    "creep_time_constants_s": (0.1, 1.0, 10.0, 100.0),
    "creep_weights": (0.01, 0.008, 0.009, 0.01),
}


def changed(name: str, **fields: object) -> ModelFile:
    """Return a model file of the test rigs with other fields."""
    return load_model(model_path(name)).model_copy(update=fields)


def loaded(file: ModelFile) -> LoadedModel:
    """Return the object of a model file."""
    return LoadedModel(file, from_model_file(file), None, RATE_HZ)


def with_exponent(exponent: float) -> ModelFile:
    """Return the model with a part that relaxes along the path, and hardly where it is small."""
    path = changed("path").surface_path
    assert path is not None
    return changed("path", surface_path=path.model_copy(update={"exponent": exponent}))


MODELS: Final[Mapping[str, Callable[[], ModelFile]]] = {
    "stops": lambda: changed("stops", creep_time_constants_s=(), creep_weights=()),
    "stops-creep": lambda: changed("stops", **CREEPING),
    "surface": lambda: changed("surface"),
    "surface-creep": lambda: changed("surface", **CREEPING),
    "lag": lambda: changed("lag"),
    "path": lambda: changed("path", **CREEPING),
    "path-exponent": lambda: with_exponent(1.7),
    "inside": lambda: changed("stops", drive_low_v=-50.0, **CREEPING),
    "surface-inside": lambda: changed("surface", drive_low_v=-50.0, **CREEPING),
}
"""Each part that a model may have; the last ones rest inside their range."""


def signals(count: int) -> Mapping[str, FloatArray]:
    """Return positions in units of the range, shape (count,) each, by name."""
    draws, k = np.random.default_rng(7), np.arange(count)
    walk = np.cumsum(draws.uniform(-0.02, 0.02, count))
    turns = k % 200  # alternates between two sides, more often than the memory holds
    wild = draws.uniform(-0.2, 1.2, count)
    wild[draws.uniform(size=count) < 0.05] = np.nan
    return {
        "sines": 0.5 - 0.3 * np.cos(k / 150.0) - 0.19 * np.cos(k / 17.3),
        "decays": 0.5 + 0.49 * np.exp(-(k % 20_000) / 5000.0) * np.sin(k / 50.0),
        "walk": np.abs((walk % 2.0) - 1.0),
        "noise": draws.uniform(0.0, 1.0, count),
        "nan and outside": wild,
        "overflow": 0.5 + 0.45 * (-1.0) ** turns * 0.985**turns,
    }
