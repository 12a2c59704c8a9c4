"""YAML files that a command reads."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from piezod.config.fields import Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml

ModelT = TypeVar("ModelT", bound=BaseModel)


def load_file(file: Path, model: type[ModelT]) -> ModelT:
    """Return the contents of a YAML file, checked.

    Raises:
        ConfigError: If they are not valid; the text lists every problem with its place.
    """
    return validate(load_yaml(file), model, Context(file.parent))
