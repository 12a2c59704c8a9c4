"""A copy of a configuration as it was accepted, which later edits of the files do not change.

The loop process accepts a configuration, because only it loads the drivers and the control law, and
writes the copy. `piezod safe` reads the copy, and so does a reload that has to go back. It is a
configuration like any other, in a folder of its own and with the file's own name, which is that of
the stage; model files are copied beside it, and every other path is absolute.
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from piezod.config.daemon import DaemonConfig
from piezod.config.fields import Context
from piezod.config.validate import validate
from piezod.config.yaml_loader import parse_yaml
from piezod.errors import naming


def document(config: DaemonConfig) -> dict[str, Any]:
    """Return a configuration as JSON, with the values it sets itself; its paths are absolute."""
    text = json.dumps(config.model_dump(exclude_unset=True), default=_absolute)
    plain: dict[str, Any] = json.loads(text)
    return plain


def _absolute(value: object) -> str:
    if not isinstance(value, Path):
        raise TypeError(f"{type(value).__name__} has no place in a configuration")
    return str(value.absolute())


def keep(config: DaemonConfig, folder: Path, name: str) -> Path:
    """Write the copy of a configuration into a folder, which it replaces; return its path.

    Args:
        config: The configuration.
        folder: The folder; its contents are removed.
        name: Name of the stage.

    Raises:
        OSError: If it cannot be written.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(mode=0o700)
    text = document(config)
    for axis, axis_config in config.axes.items():
        if axis_config.model is not None:
            copy = (folder / f"model-{axis}.yaml").absolute()
            with naming(copy):
                copy.write_bytes(axis_config.model.read_bytes())
            text["axes"][axis]["model"] = str(copy)
    path = folder / f"{name}.yaml"
    with naming(path):
        path.write_text(json.dumps(text, indent=1, ensure_ascii=False), encoding="utf-8")
    return path


def parsed(text: str, source: Path) -> DaemonConfig:
    """Return an accepted configuration; loads no driver.

    The options of devices stay as they are in the text: only drivers know their meaning.

    Args:
        text: What `document` gave, as JSON.
        source: The file under whose name problems are reported.

    Raises:
        ConfigError: If it is not valid.
    """
    found = parse_yaml(text, str(source))
    drivers = _KeptDrivers([device["driver"] for device in found.data.get("devices", {}).values()])
    return validate(found, DaemonConfig, Context(source.parent, drivers))


class _KeptOptions(BaseModel):
    """Options that were validated when the configuration was accepted."""

    model_config = ConfigDict(extra="allow", frozen=True)


class _KeptPlugin:
    """What the configuration asks of a driver; accepts everything."""

    options_model: type[BaseModel] = _KeptOptions

    def channels(self, _options: BaseModel) -> None:
        """Accept any channel."""


class _KeptDrivers:
    """The drivers of an accepted configuration; implements `config.fields.Drivers`."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names

    def names(self) -> Sequence[str]:
        """Return the names of the drivers."""
        return self._names

    def load(self, _name: str) -> _KeptPlugin:
        """Return a plug-in that accepts everything."""
        return _KeptPlugin()
