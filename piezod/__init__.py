"""A daemon that moves a piezo stage along its command, hysteresis compensated.

`piezod.__version__` is the version of the installed distribution. `piezod.load_model` opens a model
file: voltages for positions, without a daemon.
"""

from importlib import import_module
from typing import Any

_MODELS = "piezod.inverse.loaded_model"


def __getattr__(name: str) -> Any:
    """Look a name up when asked: that costs more than importing the package."""
    # By name, because the package is imported by its rooms, and would import most of them. The
    # types are in the stub file beside this one.
    if name == "load_model":
        return import_module(_MODELS).load_model
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("importlib.metadata").version("piezod")


def build() -> str:
    """Return "compiled" if the modules that a cycle runs are machine code, else "interpreted"."""
    light = import_module("piezod.units")  # one of them
    return "interpreted" if str(light.__file__).endswith(".py") else "compiled"
