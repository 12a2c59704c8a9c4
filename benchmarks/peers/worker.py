"""Evaluates one method of a library; its process has the libraries, and nothing of piezod.

Run by `benchmarks.peers.libraries` with the name of the method and the file of the records; prints
its row as JSON.
"""

import json
import sys
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.peers.evaluation import evaluate
from benchmarks.peers.method import Method, Series

NARX: Final = "NARX"
MLP: Final = "MLP"
BOOSTING: Final = "gradient boosting"
ABOUT: Final = {
    NARX: "sysidentpy FROLS, polynomial, inputs x, dx, sign dx, run freely on its own outputs; "
    "degree 2, 3, lags 1, 2, terms 8, 16, step 4, 16, 48 samples",
    MLP: "scikit-learn MLPRegressor, 16 + 16 units, lbfgs, on position, direction and turning "
    "points; k 1, 2, 4 turns, last or remaining ones, alpha 0.001, 0.03",
    BOOSTING: "scikit-learn HistGradientBoostingRegressor, 300 trees, on the same features; k 1, 2,"
    " 4 turns, last or remaining ones, leaves 15, 63",
}
"""Methods of libraries and their settings, for people, by name."""


def method_of(name: str) -> Method:
    """Return a method; only its own library is imported."""
    if name == NARX:
        from benchmarks.peers.narx import NARX_METHOD  # noqa: PLC0415 - see above

        return NARX_METHOD
    from benchmarks.peers.learned import BOOSTING_METHOD, MLP_METHOD  # noqa: PLC0415 - see above

    return {MLP: MLP_METHOD, BOOSTING: BOOSTING_METHOD}[name]


def main() -> None:
    """Measure and print the row."""
    name, path = sys.argv[1], Path(sys.argv[2])
    with np.load(path) as arrays:
        record, test = (
            Series(*(arrays[f"{which}_{field}"] for field in ("positions", "drives", "counted")))
            for which in ("record", "test")
        )
        without_offset = bool(arrays["without_offset"])
    row = evaluate(method_of(name), record, test, without_offset=without_offset)
    print(json.dumps(row.document()))


if __name__ == "__main__":
    main()
