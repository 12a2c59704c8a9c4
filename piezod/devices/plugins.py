"""Lookup of plug-ins by name, among all installed distributions.

A plug-in is an entry point. Listing names imports nothing. A plug-in is imported on request only,
so a broken one does no harm to the others.
"""

import sys
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from pathlib import Path
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
    return tuple(sorted({point.name for point in points_of(group)}))


def points_of(group: str) -> EntryPoints:
    """Return the entry points of a group.

    A search reads a file of every installed distribution. It is repeated only if a folder of the
    import path has changed: an installation changes one.
    """
    return _search(group, tuple((folder, _changed_ns(folder)) for folder in sys.path))


@lru_cache(maxsize=8)
def _search(group: str, folders: tuple[tuple[str, int], ...]) -> EntryPoints:  # noqa: ARG001 - a key
    return entry_points(group=group)


def _changed_ns(folder: str) -> int:
    try:
        return Path(folder).stat().st_mtime_ns
    except OSError:
        return 0  # also for a folder that does not exist yet


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
    try:
        plugin = point.load()
    except Exception as error:
        # A plug-in is foreign code and may fail in any way while it is imported.
        text = f"cannot be imported: {type(error).__name__}: {error}"
        raise _bad(kind, point, text) from error
    if not isinstance(plugin, plugin_type):
        found, wanted = type(plugin).__name__, plugin_type.__name__
        raise _bad(kind, point, f"is of type {found}, not {wanted}")
    if plugin.name != name:
        raise _bad(kind, point, f"calls itself {plugin.name!r}: the two names must agree")
    return plugin


def _bad(kind: str, point: EntryPoint, what: str) -> RegistryError:
    # The distribution is read from a file, which a good plug-in needs not.
    return RegistryError(f"{kind} {point.name!r} ({point.value} of {_distribution(point)}) {what}")


def _only(group: str, kind: str, name: str) -> EntryPoint:
    # Two distributions may use the same name; a silent choice would depend on the search path.
    points = points_of(group).select(name=name)
    if len(points) == 1:
        return next(iter(points))
    known = f"known {kind}s: {', '.join(names(group)) or 'none is installed'}"
    if not points:
        raise RegistryError(f"unknown {kind} {name!r}, {known}")
    makers = " and ".join(sorted(map(_distribution, points)))
    raise RegistryError(f"{kind} {name!r} is provided by {makers}: uninstall one, {known}")


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unnamed distribution"
