"""The last scan of a stage, as its loop process has left it."""

import json
from pathlib import Path
from typing import Final

import numpy as np

from piezod.daemon.stage.errors import UnknownNameError
from piezod.messages.documents import Document, plain

MOST_VALUES: Final = 60_000
"""Most samples in an answer, of all columns together; but at least those of one sweep."""


def scanned_part(state_file: Path, rows_file: Path, first: int) -> Document:
    """Return the state of the last scan, and the samples of some sweeps.

    Args:
        state_file: File with its state.
        rows_file: File with its samples.
        first: Index of the first sweep.

    Raises:
        UnknownNameError: If nothing was scanned.
    """
    try:
        document: Document = json.loads(state_file.read_text(encoding="utf-8"))
        file = rows_file.open("rb")
    except FileNotFoundError:
        what = "nothing was scanned since this machine started"
        raise UnknownNameError(what, "`piezod scan` scans") from None
    names, points = [*document["axes"], *document["inputs"]], document["points"]
    most = max(1, MOST_VALUES // (points * len(names)))
    sweeps = max(0, min(document["done"] - first, most))
    with file:
        file.seek(first * points * len(names) * 4)
        data = file.read(sweeps * points * len(names) * 4)
    rows = np.frombuffer(data, "<f4").reshape(-1, len(names)).astype(np.float64)
    # As many digits as a number of single precision has.
    columns = {
        name: [float(f"{value:.7g}") for value in rows[:, i].tolist()]
        for i, name in enumerate(names)
    }
    return {**document, "first": first, "samples": plain(columns)}
