"""Reading of the header of a recording."""

import h5py

from piezod.errors import DataError
from piezod.records.nexus import axis_names
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.layout import Named


def read_header(entry: h5py.Group) -> TelemetryHeader:
    """Return the header of a recording.

    Raises:
        KeyError: If the entry is not that of a recording.
    """
    fields = {
        name: dataset
        for key, group in entry.items()
        if key == "cycles" or key.startswith("axis_")
        for name, dataset in group.items()
        if name != "t_s"
    }
    axes = axis_names(entry)
    return TelemetryHeader(
        title=str(entry["title"].asstr()[()]),
        axes=axes,
        rate_hz=float(entry.attrs["rate_hz"]),
        started_at=str(entry["start_time"].asstr()[()]),
        start_ns=int(entry.attrs["start_ns"]),
        names=Named(
            "names of",
            {name: numbers for name, each in fields.items() if (numbers := names_of_numbers(each))},
        ),
        notes={
            name: str(group["data"].asstr()[()])
            for name, group in entry.items()
            if group.attrs.get("NX_class") == "NXnote"
        },
        weights={
            # Those of the start; the shape may have grown with an adopted model.
            name: entry[f"weights_{name}/weights"].chunks[1]
            for name in axes
            if f"weights_{name}" in entry
        },
        surfaces=tuple(
            name
            for name in axes
            if f"weights_{name}" in entry and entry[f"weights_{name}"].attrs.get("surface", False)
        ),
        descriptions={
            name: str(each.attrs["description"])
            for name, each in fields.items()
            if "description" in each.attrs
        },
        bits={
            name: tuple(text.partition(" = ")[2] for text in each.attrs["bits"])
            for name, each in fields.items()
            if "bits" in each.attrs
        },
        part=int(entry.attrs.get("part", 1)),
    )


def names_of_numbers(dataset: h5py.Dataset) -> tuple[str, ...]:
    """Return the names of the numbers of a column, from that of 0; none of a plain column.

    Raises:
        DataError: If a number between 0 and the last one has no name.
    """
    numbers = h5py.check_enum_dtype(dataset.dtype)
    if not numbers or set(numbers) == {"FALSE", "TRUE"}:  # h5py stores bool as such an enum
        return ()
    names = tuple(sorted(numbers, key=numbers.__getitem__))
    if [numbers[name] for name in names] != list(range(len(names))):
        raise DataError(f"it is damaged: the numbers of {dataset.name} are not 0, 1, 2, …")
    return names
