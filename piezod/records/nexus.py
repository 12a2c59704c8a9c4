"""The HDF5 files of this package in the layout of NeXus: how their groups and datasets are made.

Experiments and recordings are written with these functions. So their files have the same kinds of
groups, units by the names of columns, and compression.
"""

from collections.abc import Mapping
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

CHUNK_CACHE_BYTES: Final = 0
"""Cache per dataset: chunks are read and written whole, and HDF5 would keep 8 MB of each column."""
_UNITS: Final = {"ns": "ns", "um": "um", "v": "V", "s": "s"}


def unit_of(column: str) -> str:
    """Return the unit of a column, from the end of its name; "" for numbers without one."""
    return _UNITS.get(column.rsplit("_", 1)[-1], "")


def axis_names(entry: h5py.Group) -> tuple[str, ...]:
    """Return the names of the axes of a stage in a recording.

    Raises:
        KeyError: If the entry is not that of a recording.
    """
    # Files of older versions have `axes`, which NeXus keeps for the groups of data.
    attributes = entry.attrs
    names = attributes["axis_names" if "axis_names" in attributes else "axes"]
    return tuple(str(name) for name in names)


def new_entry(file: h5py.File, name: str, **creator: str) -> h5py.Group:
    """Make an empty file one of NeXus, with attributes of its creator; return its only entry."""
    for attribute, text in {"NX_class": "NXroot", "default": name, **creator}.items():
        file.attrs[attribute] = text
    return new_group(file, name, "NXentry")


def new_group(parent: h5py.Group, name: str, nexus_class: str) -> h5py.Group:
    """Return a new group whose members keep their order."""
    # Without track_order HDF5 sorts by name.
    group = parent.create_group(name, track_order=True)
    group.attrs["NX_class"] = nexus_class
    return group


def new_data(
    parent: h5py.Group, name: str, signal: str, axes: str = "t_s", about: str = ""
) -> h5py.Group:
    """Return a new group of columns, which a viewer plots.

    Args:
        parent: Group in which it is made.
        name: Its name.
        signal: Column to plot.
        axes: Column over which it is plotted.
        about: Description, for people; empty for none.
    """
    group = new_group(parent, name, "NXdata")
    if about:
        group.attrs["description"] = about
    group.attrs["signal"], group.attrs["axes"] = signal, axes
    return group


def new_collection(parent: h5py.Group, name: str, values: Mapping[str, float | str]) -> None:
    """Make a group that has the values as attributes."""
    collection = new_group(parent, name, "NXcollection")
    for key, value in values.items():
        collection.attrs[key] = value


def new_column(group: h5py.Group, name: str, values: NDArray[np.float64], long_name: str) -> None:
    """Make a dataset with values, and with the unit of its name."""
    # Shuffling puts equal bytes of neighbouring numbers together, which then compress well.
    dataset = group.create_dataset(name, data=values, compression="gzip", shuffle=True)
    dataset.attrs["units"] = unit_of(name)
    dataset.attrs["long_name"] = long_name


def growing_column(
    group: h5py.Group,
    name: str,
    dtype: npt.DTypeLike,
    chunk: int,
    *row: int,
    about: str = "",
    **options: Any,
) -> h5py.Dataset:
    """Return a new dataset without rows, which `grow` adds, and with the unit of its name.

    Args:
        group: Group in which it is made.
        name: Its name.
        dtype: Type of its numbers or texts.
        chunk: Rows per chunk.
        row: Shape of a row; none for one value.
        about: Description, for people; empty for none.
        options: Further options of `create_dataset`, in place of the usual ones.
    """
    usual = {
        "maxshape": (None, *row),
        "compression": "gzip",
        "compression_opts": 1,  # the fastest level: the writer must keep up with the loop
        "shuffle": True,
    }
    dataset = group.create_dataset(
        name, (0, *row), dtype, chunks=(chunk, *row), **{**usual, **options}
    )
    if about:
        dataset.attrs["description"] = about
    dataset.attrs["units"] = unit_of(name)
    return dataset


def grow(dataset: h5py.Dataset, values: NDArray[Any]) -> None:
    """Add rows to a dataset."""
    before = len(dataset)
    dataset.resize(before + len(values), axis=0)
    dataset[before:] = values
