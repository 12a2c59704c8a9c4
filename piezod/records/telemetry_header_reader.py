"""Reading of the header of a recording."""

import h5py

from piezod.records.nexus import axis_names
from piezod.records.telemetry_header import TelemetryHeader


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
    enumerations = {name: h5py.check_enum_dtype(each.dtype) for name, each in fields.items()}
    return TelemetryHeader(
        title=str(entry["title"].asstr()[()]),
        axes=axes,
        rate_hz=float(entry.attrs["rate_hz"]),
        started_at=str(entry["start_time"].asstr()[()]),
        start_ns=int(entry.attrs["start_ns"]),
        names={
            name: tuple(sorted(numbers, key=numbers.__getitem__))
            for name, numbers in enumerations.items()
            if numbers and set(numbers) != {"FALSE", "TRUE"}  # h5py stores bool as such an enum
        },
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
