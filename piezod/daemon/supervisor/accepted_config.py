"""A copy of a configuration as it was accepted, which later edits of the files do not change.

The loop process and `piezod safe` read the copy, and so does a reload that has to go back. It is a
configuration like any other, in a folder of its own and with the file's own name, which is that of
the stage; model files are copied beside it, and every other path in it is absolute.
"""

import json
import shutil
from pathlib import Path
from typing import Any

from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.control.assembly import check_stage
from piezod.devices import registry
from piezod.errors import ConfigError, DataError, ModelError, Problem


def load(path: Path, *, strict_rt: bool = False) -> DaemonConfig:
    """Read the configuration of a stage; opens no device.

    Args:
        path: The file.
        strict_rt: Whether `loop.strict_rt` is to be set, whatever the file says.

    Raises:
        ConfigError: If it is not valid, or a gain in it is not safe.
    """
    config = load_daemon(path, registry)
    try:
        check_stage(config)
    except (DataError, ModelError) as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error
    if strict_rt:
        loop = config.loop.model_copy(update={"strict_rt": True})
        config = config.model_copy(update={"loop": loop})
    return config


def document(config: DaemonConfig) -> dict[str, Any]:
    """Return a configuration as JSON, with what it says itself; its paths are absolute."""
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
        folder: The folder; what is in it is removed.
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
            shutil.copyfile(axis_config.model, copy)
            text["axes"][axis]["model"] = str(copy)
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(text, indent=1, ensure_ascii=False), encoding="utf-8")
    return path
