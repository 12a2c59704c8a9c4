"""What the HDF5 files of this package share: groups with a class of NeXus."""

from typing import Final

import h5py

CHUNK_CACHE_BYTES: Final = 0
"""Cache per dataset: chunks are read and written whole, and HDF5 would keep 8 MB of each column."""


def axis_names(entry: h5py.Group) -> tuple[str, ...]:
    """Return the names of the axes of a stage in a recording.

    Raises:
        KeyError: If the entry is not that of a recording.
    """
    # Files of older versions have `axes`, which NeXus keeps for the groups of data.
    attributes = entry.attrs
    names = attributes["axis_names" if "axis_names" in attributes else "axes"]
    return tuple(str(name) for name in names)


def new_group(parent: h5py.Group, name: str, nexus_class: str) -> h5py.Group:
    """Return a new group whose members keep their order."""
    # Without track_order HDF5 sorts by name.
    group = parent.create_group(name, track_order=True)
    group.attrs["NX_class"] = nexus_class
    return group
