"""Lookup of plug-ins by name, among all installed distributions.

A plug-in is an entry point. Listing names imports nothing. A plug-in is imported on request only,
so a broken one does no harm to the others.
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Protocol, TypeVar

from piezod.errors import RegistryError


class Named(Protocol):
    """A plug-in with a name."""

    @property
    def name(self) -> str:
        """Name of the plug-in, equal to that of its entry point."""
        ...


PluginT = TypeVar("PluginT", bound=Named)


def names(group: str) -> tuple[str, ...]:
    """Return the names of all installed plug-ins, sorted, without importing them.

    Args:
        group: Group of their entry points.
    """
    return tuple(sorted({point.name for point in entry_points(group=group)}))


def load(group: str, kind: str, plugin_type: type[PluginT], name: str) -> PluginT:
    """Import and return one plug-in. Not for use in the loop.

    Args:
        group: Group of its entry point.
        kind: Kind of plug-in, for messages.
        plugin_type: Its class.
        name: Its name, one of `names(group)`.

    Raises:
        RegistryError: If no plug-in or several have this name, or if it cannot be imported or is
            not a plug-in of that name.
    """
    point = _only(group, kind, name)
    origin = f"{kind} {name!r} ({point.value} of {_distribution(point)})"
    try:
        plugin = point.load()
    except Exception as error:
        # A plug-in is foreign code and may fail in any way while it is imported.
        text = f"{origin} cannot be imported: {type(error).__name__}: {error}"
        raise RegistryError(text) from error
    if not isinstance(plugin, plugin_type):
        found, wanted = type(plugin).__name__, plugin_type.__name__
        raise RegistryError(f"{origin} is of type {found}, not {wanted}")
    if plugin.name != name:
        raise RegistryError(f"{origin} calls itself {plugin.name!r}: the two names must agree")
    return plugin


def _only(group: str, kind: str, name: str) -> EntryPoint:
    # Two distributions may use the same name; a silent choice would depend on the search path.
    points = entry_points(group=group, name=name)
    known = f"known {kind}s: {', '.join(names(group)) or 'none is installed'}"
    if not points:
        raise RegistryError(f"unknown {kind} {name!r}, {known}")
    if len(points) > 1:
        makers = " and ".join(sorted(map(_distribution, points)))
        raise RegistryError(f"{kind} {name!r} is provided by {makers}: uninstall one, {known}")
    return next(iter(points))


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unnamed distribution"
