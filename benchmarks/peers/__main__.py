"""Compares inverse models of hysteresis by others with those of piezod, on the same records.

`python -m benchmarks.peers` runs every record and every method; `--record` and `--method` choose
those whose name contains the word. Methods of libraries run in the environment of
`make bench-peers`.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.peers.bouc_wen import BOUC_WEN
from benchmarks.peers.branches import BRANCHES
from benchmarks.peers.evaluation import evaluate
from benchmarks.peers.libraries import LIBRARY_METHODS, row_of_library
from benchmarks.peers.method import Row, Series
from benchmarks.peers.ours import rows_of_piezod
from benchmarks.peers.plays import CLASSICAL, KUHNEN
from benchmarks.peers.records import CASES, Absent, Case
from benchmarks.peers.table import PIEZOD, table_of
from piezod.errors import PiezodError

OWN = {method.name: method for method in (CLASSICAL, KUHNEN, BOUC_WEN, BRANCHES)}
"""Methods by others that are implemented here."""
METHODS = (PIEZOD, *OWN, *LIBRARY_METHODS)
LEGEND = """\
Errors of the voltage predicted from the displacement, in % of the range of the voltage. All methods
get the same samples: delay taken out, displacement smoothed as piezod does it.
held-out: five contiguous blocks, each predicted by a fit to the others; the settings are chosen by
the rms error on these blocks, for all methods. The memory of a model runs through the whole record.
fit s: one fit with these settings. µs/sample: prediction of a whole record in Python, divided by
its samples; it is no step of a loop. Marked rows are better than the best row of piezod by more
than 10 %.
"""


def main() -> None:
    """Measure and print."""
    options = _options()
    records = _chosen(options.record, CASES, "record")
    methods = _chosen(options.method, METHODS, "method")
    print(LEGEND)
    for name, method in OWN.items():
        print(f"{name}: {method.about}")
    for name, about in LIBRARY_METHODS.items():
        print(f"{name}: {about}")
    document: dict[str, Any] = {}
    for name in records:
        try:
            case = CASES[name]()
        except (Absent, PiezodError) as reason:
            print(f"\n{name}: skipped, {reason}")
            document[name] = {"skipped": str(reason)}
            continue
        print(f"\n{name}, {case.about}", flush=True)
        rows = _rows(case, methods)
        print(table_of(rows), flush=True)
        document[name] = {"about": case.about, "rows": [row.document() for row in rows]}
    if options.json:
        options.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--record", action="append", help=f"of {', '.join(CASES)}")
    parser.add_argument("--method", action="append", help=f"of {', '.join(METHODS)}")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the tables there, too")
    return parser.parse_args()


def _chosen(words: Sequence[str] | None, names: Iterable[str], what: str) -> list[str]:
    """Return the names that contain one of the words; all of them without words."""
    chosen = [name for name in names if not words or any(word in name for word in words)]
    if not chosen:
        sys.exit(f"no {what} is called {' or '.join(words or ())}; there are {', '.join(names)}")
    return chosen


def _rows(case: Case, names: Sequence[str]) -> list[Row]:
    record, test = case.series()
    rows: list[Row] = []
    for name in names:
        try:
            if name == PIEZOD:
                rows += rows_of_piezod(case)
            else:
                rows.append(_row_of_peer(name, record, test, without_offset=case.without_offset))
        except (PiezodError, ValueError) as error:  # a fit may refuse a record, or diverge
            rows.append(Row(name, failure=str(error)))
        print(f"  {name} done", file=sys.stderr, flush=True)
    return rows


def _row_of_peer(name: str, record: Series, test: Series, *, without_offset: bool) -> Row:
    if name in OWN:
        return evaluate(OWN[name], record, test, without_offset=without_offset)
    return row_of_library(name, record, test, without_offset=without_offset)


if __name__ == "__main__":
    main()
