"""Lookup of drivers by name.

A driver is an entry point of the group `piezod.drivers` that refers to a `DriverPlugin`.
"""

from typing import Any, Final

from piezod.devices import plugins
from piezod.devices.interface import DriverPlugin

GROUP: Final = "piezod.drivers"


def names() -> tuple[str, ...]:
    """Return the names of all installed drivers, sorted, without importing them."""
    return plugins.names(GROUP)


def load(name: str) -> DriverPlugin[Any]:
    """Import and return the plug-in of one driver. Not for use in the loop.

    Args:
        name: Name of the driver, one of `names()`.

    Raises:
        RegistryError: If no driver or several have this name, or if it cannot be imported or is not
            a plug-in of that name.
    """
    return plugins.load(GROUP, "driver", DriverPlugin, name)
