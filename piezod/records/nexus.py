"""What the HDF5 files of this package share: groups with a class of NeXus."""

from typing import Final

import h5py

CHUNK_CACHE_BYTES: Final = 0
"""Cache per dataset: chunks are read and written whole, and HDF5 would keep 8 MB of each column."""


def new_group(parent: h5py.Group, name: str, nexus_class: str) -> h5py.Group:
    """Return a new group whose members keep their order."""
    # Without track_order HDF5 sorts by name.
    group = parent.create_group(name, track_order=True)
    group.attrs["NX_class"] = nexus_class
    return group
