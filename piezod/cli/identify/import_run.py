"""The work of `piezod import`."""

from pathlib import Path

import numpy as np

from piezod.cli.output import new_console, print_json, print_warnings
from piezod.cli.record.recordings import checked_out
from piezod.experiment.fit.source import Source, read_source
from piezod.reading.choices import Choices
from piezod.records.csv_file import write_csv
from piezod.records.figures.imported import imported_figure
from piezod.records.figures.style import save_png


def import_file(data: Path, choices: Choices, out: Path | None, *, json: bool) -> None:
    """Read a file, write it if there is a path, and print what was understood."""
    path = None if out is None else checked_out(out, out, (".csv",), data)
    found = read_source(data, 0.0, choices=choices, command="import")
    columns = {name: getattr(found.record, name) for name in ("t_s", "drive_v", "position_um")}
    figure = None if path is None else path.with_suffix(".png")
    if path and figure:
        write_csv(path, columns)
        save_png(figure, imported_figure(data.name, columns))
    document = _document(data, found) | {
        "file": str(path) if path else None,
        "figure": str(figure) if figure else None,
    }
    if json:
        print_json(document)
        return
    console = new_console()
    console.print(f"{data}: {document['samples']} samples at {document['rate_hz']:.6g} Hz")
    for each in found.understood or ("As piezod writes it.",):
        console.print(each, markup=False, soft_wrap=True)
    for name in ("drive_v", "position_um"):
        console.print(f"{name} from {columns[name].min():.6g} to {columns[name].max():.6g}")
    print_warnings(console, found.notes)
    if path:
        console.print(f"Record: {path}\nFigure: {figure}", soft_wrap=True)
    else:
        console.print("Nothing was written; --out record.csv writes the record and its picture.")


def _document(data: Path, found: Source) -> dict[str, object]:
    record = found.record
    return {
        "data": str(data),
        "read_as": found.understood,
        "samples": record.t_s.size,
        "rate_hz": 1.0 / record.period_s,
        "drive_v": [float(np.min(record.drive_v)), float(np.max(record.drive_v))],
        "position_um": [float(np.min(record.position_um)), float(np.max(record.position_um))],
        "warnings": found.notes,
    }
