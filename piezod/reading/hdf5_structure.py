"""Judges the structure of an HDF5 file of unknown origin, before its contents are read.

HDF5 can lead out of a file, allocate what it likes, and run foreign code. What the files of this
package have is a small part of that; anything else is refused.
"""

from collections.abc import Collection, Iterator
from typing import Any, Final

import h5py
from h5py import h5d, h5o, h5z

from piezod.errors import DataError

MOST_OBJECTS: Final = 20_000
"""Largest number of groups and datasets of a file."""
MOST_ATTRIBUTES: Final = 1000
"""Largest number of attributes of a group or dataset."""
LONGEST_NAME: Final = 255
MOST_CHUNK_BYTES: Final = 64_000_000
"""Largest part that HDF5 has to expand at once."""
MOST_EXPANSION: Final = 1100
"""gzip expands a byte to 1032 at most; more was never written."""
_SLACK_BYTES: Final = 16_000_000
_MOST_TEXT_BYTES: Final = 4_000_000
"""Largest size of an attribute, and of a dataset of texts."""
_FILTERS: Final = (h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32)
_FOREIGN_FILTERS: Final = (*_FILTERS, h5z.FILTER_LZF)
_NUMBERS: Final = "biuf"


def check_structure(file: h5py.File) -> None:
    """Check that a file consists of plain groups and datasets of bounded size, all in itself.

    Raises:
        DataError: If it does not; the text has the place in the file.
    """
    for place, item in _objects(file):
        if len(item.attrs) > MOST_ATTRIBUTES:
            raise _refused(place, f"{len(item.attrs)} attributes", f"at most {MOST_ATTRIBUTES}")
        for name in item.attrs:
            _check_attribute(f"{place}@{name[:LONGEST_NAME]}", item, name)
        if isinstance(item, h5py.Dataset):
            _check_dataset(place, item)


def usable_datasets(file: h5py.File) -> tuple[dict[str, h5py.Dataset], str]:
    """Return the datasets of another program's file that can be read, by their paths.

    Anything else in the file is left alone. The second value is why a dataset cannot be read; empty
    if all can.

    Raises:
        DataError: If there are too many objects.
    """
    usable, reason = {}, ""
    for place, item in _objects(file, foreign=True):
        if isinstance(item, h5py.Dataset):
            try:
                _check_dataset(place, item, _FOREIGN_FILTERS)
            except DataError as error:
                reason = reason or str(error)
            else:
                usable[place] = item
    return usable, reason


def _objects(
    file: h5py.File, *, foreign: bool = False
) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Yield every group and dataset once, with its path; refuse links and other objects.

    In a foreign file those are passed over.
    """
    pending: list[tuple[str, h5py.Group]] = [("", file["/"])]
    seen = {h5o.get_info(file["/"].id).addr}
    yield "/", file["/"]
    found = 0
    while pending:
        above, group = pending.pop()
        found += len(group)
        if found > MOST_OBJECTS:
            raise _refused(above or "/", f"more than {MOST_OBJECTS} objects", "fewer")
        for name in group:
            if len(name) > LONGEST_NAME:
                what = f"a name of {len(name)} characters"
                raise _refused(above or "/", what, f"at most {LONGEST_NAME}")
            place, link = f"{above}/{name}", group.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                if foreign:
                    continue
                raise _refused(place, "a link, which may lead anywhere", "data in the file itself")
            item = group[name]
            if not isinstance(item, h5py.Group | h5py.Dataset):
                if foreign:
                    continue
                raise _refused(place, "neither group nor dataset", "these two")
            if (address := h5o.get_info(item.id).addr) in seen:
                continue
            seen.add(address)
            yield place, item
            if isinstance(item, h5py.Group):
                pending.append((place, item))


def _check_attribute(place: str, item: h5py.Group | h5py.Dataset, name: str) -> None:
    attribute = item.attrs.get_id(name)
    if attribute.get_storage_size() > _MOST_TEXT_BYTES:
        raise _refused(place, "a large attribute", f"at most {_MOST_TEXT_BYTES} bytes")
    if _is_plain(attribute.dtype):
        _ = item.attrs[name]  # texts of any length are elsewhere in the file


def _check_dataset(place: str, dataset: h5py.Dataset, filters: Collection[int] = _FILTERS) -> None:
    if dataset.shape is None or not _is_plain(dataset.dtype):
        raise _refused(place, f"data of the type {dataset.dtype}", "numbers and texts")
    layout = dataset.id.get_create_plist()
    if layout.get_layout() == h5d.VIRTUAL or layout.get_external_count():
        raise _refused(place, "data in another file", "data in the file itself")
    for number in range(layout.get_nfilters()):
        if layout.get_filter(number)[0] not in filters:
            raise _refused(place, "an unknown compression", "gzip, shuffle, fletcher32")
    item_bytes = dataset.dtype.itemsize
    chunk_bytes = item_bytes
    for rows in dataset.chunks or ():
        chunk_bytes *= rows
    if chunk_bytes > MOST_CHUNK_BYTES:
        what = f"chunks of {chunk_bytes} bytes"
        raise _refused(place, what, f"at most {MOST_CHUNK_BYTES} bytes")
    size_bytes = int(dataset.size) * item_bytes
    stored_bytes = dataset.id.get_storage_size()  # looks at the whole index of the chunks
    if size_bytes > MOST_EXPANSION * stored_bytes + _SLACK_BYTES:
        what = f"{size_bytes} bytes that {stored_bytes} stored bytes cannot contain"
        raise _refused(place, what, f"{MOST_EXPANSION} times as many")
    if h5py.check_string_dtype(dataset.dtype) is not None and dataset.dtype.kind == "O":
        if size_bytes > _MOST_TEXT_BYTES:
            raise _refused(place, "many texts", f"at most {_MOST_TEXT_BYTES} bytes")
        _ = dataset[()]


def _is_plain(dtype: Any) -> bool:
    return dtype.kind in _NUMBERS or h5py.check_string_dtype(dtype) is not None


def _refused(place: str, found: str, allowed: str) -> DataError:
    return DataError(
        f"{place} has {found}; allowed: {allowed}; use the file as piezod wrote it, or export its "
        "columns t_s, drive_v, position_um to CSV"
    )
