"""The columns of a recording, from a file that the recorder has laid out."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import h5py

from docs.site.reference.text import code, sentence, table
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.arrays import record_dtype
from piezod.telemetry.descriptions import descriptions, mask_bits
from piezod.telemetry.layout import enumerations


def page() -> Iterator[str]:
    """Yield the page."""
    yield "# Columns of a recording"
    yield ""
    yield "[Recordings](../recordings.md) explains the file. In the names, `x` is the axis."
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "empty.h5"
        TelemetryWriter(path, _header(), record_dtype(1)).close()
        with h5py.File(path) as file:
            for name, group in file["recording"].items():
                if isinstance(group, h5py.Group) and "signal" in group.attrs:
                    yield f"\n## `{name}`\n"
                    yield group.attrs["description"]
                    yield from table(("column", "unit", "meaning"), _columns(group))


def _header() -> TelemetryHeader:
    return TelemetryHeader(
        title="",
        axes=("x",),
        rate_hz=1000.0,
        started_at="2024-05-01T12:00:00+00:00",
        start_ns=0,
        names={name: [str(each.value) for each in all_] for name, all_ in enumerations().items()},
        weights={"x": 1},
        descriptions=descriptions(),
        bits=mask_bits(),
    )


def _columns(group: h5py.Group) -> Iterator[tuple[str, str, str]]:
    for name, column in group.items():
        text = sentence(column.attrs.get("description", ""))
        if "values" in column.attrs:
            text += " " + ", ".join(code(each) for each in column.attrs["values"])
        yield code(name), column.attrs["units"], text
