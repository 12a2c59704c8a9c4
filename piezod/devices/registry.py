"""Finds drivers by name, among all installed distributions.

A driver is an entry point of the group `piezod.drivers` that leads to a `DriverPlugin`. Looking at
names imports nothing. A plug-in is imported when it is asked for, so a broken one harms no other.
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from piezod.devices.interface import DriverPlugin
from piezod.errors import RegistryError

GROUP: Final = "piezod.drivers"


def names() -> tuple[str, ...]:
    """Tell the names of all installed drivers, sorted, without importing any of them."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def load(name: str) -> DriverPlugin[Any]:
    """Import the plug-in of one driver. Not to be called in the loop.

    Args:
        name: Name of the driver, one of `names()`.

    Raises:
        RegistryError: If no driver or several have this name, or if what carries the name cannot be
            imported or is not a plug-in of that name.
    """
    point = _only(name)
    origin = f"driver {name!r} ({point.value} of {_distribution(point)})"
    try:
        plugin = point.load()
    except Exception as error:
        # A plug-in is foreign code and may fail in any way while it is imported.
        text = f"{origin} cannot be imported: {type(error).__name__}: {error}"
        raise RegistryError(text) from error
    if not isinstance(plugin, DriverPlugin):
        raise RegistryError(f"{origin} is a {type(plugin).__name__}, not a DriverPlugin")
    if plugin.name != name:
        raise RegistryError(f"{origin} calls itself {plugin.name!r}: the two names must agree")
    return plugin


def _only(name: str) -> EntryPoint:
    points = entry_points(group=GROUP, name=name)
    if not points:
        known = ", ".join(names()) or "none is installed"
        raise RegistryError(f"unknown driver {name!r}, known drivers: {known}")
    if len(points) > 1:
        makers = " and ".join(sorted(map(_distribution, points)))
        known = ", ".join(names())
        text = f"driver {name!r} is provided by {makers}: uninstall one, known drivers: {known}"
        raise RegistryError(text)
    return next(iter(points))


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unnamed distribution"
