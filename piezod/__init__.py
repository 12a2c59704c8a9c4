"""A daemon that moves a piezo stage along its command, hysteresis compensated.

`piezod.__version__` is the version of the installed distribution.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> str:
        """Look the version up when asked: that costs more than importing the package."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import version  # noqa: PLC0415 - see above

        return version("piezod")


def build() -> str:
    """Return "compiled" if the modules that a cycle runs are machine code, else "interpreted"."""
    from piezod import units  # noqa: PLC0415 - one of them, and light

    return "interpreted" if str(units.__file__).endswith(".py") else "compiled"
