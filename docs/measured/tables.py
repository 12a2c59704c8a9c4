"""Tables of the appendix from stored results, and the marks between which they stand.

Results of long runs are files of this folder, so that the page can be made without the runs.
"""

import csv
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.peers.method import Row
from benchmarks.peers.table import ERRORS, better_than_piezod, error_text, sorted_rows

FOLDER: Final = Path(__file__).parent
PAGE: Final = FOLDER.parent / "measurements.md"
SOAK: Final = {
    "hours": "simulated time, h",
    "rate_hz": "rate of the loop, Hz",
    "model": "model",
    "seed": "seed",
    "processor_min": "time of a processor, min",
    "daemons": "daemons",
    "faults": "faults",
    "output_faults": "injected faults of output and read-back",
    "plays": "plays",
    "writes": "writes",
    "piezod_step_v": "largest step by piezod, V",
    "amplifier_step_v": "largest step by the amplifier itself, V",
    "error_rms_median_pct": "error in motion, rms of a minute, median, %",
    "error_rms_worst_pct": "the same, worst minute, %",
    "drift_worst_pct": "largest difference of the learned model, %",
    "violations": "broken bounds",
}
"""Numbers of `soak.json`, in the order of the table."""
_MARK: Final = re.compile(
    r"(<!-- (\S+): made by `python -m docs\.measured`, begin -->\n).*?(<!-- end -->\n)", re.DOTALL
)


def names(page: str) -> list[str]:
    """Return the names of the tables that a page has room for."""
    return [name for _, name, _ in _MARK.findall(page)]


def filled(page: str, name: str, lines: Iterable[str]) -> str:
    """Return the page with one of its tables written anew."""
    text = "\n".join(lines).strip()

    def fill(mark: re.Match[str]) -> str:
        return f"{mark[1]}\n{text}\n\n{mark[3]}" if mark[2] == name else mark[0]

    return _MARK.sub(fill, page)


def save(name: str, rows: Iterable[Sequence[str]]) -> None:
    """Store a table of results, its headings first, as `stored` reads it."""
    with (FOLDER / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def stored(name: str) -> Iterator[str]:
    """Yield the Markdown of a stored table, without columns that are empty."""
    with (FOLDER / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        columns, *rows = csv.reader(file)
    used = [i for i in range(len(columns)) if any(row[i] for row in rows)]
    return markdown([columns[i] for i in used], [[row[i] for i in used] for row in rows])


def peers() -> Iterator[str]:
    """Yield the tables of `make bench-peers`, one for each record."""
    for name, record in _document("peers").items():
        if "rows" not in record:
            continue  # its data were missing
        rows = [Row.from_document(row) for row in record["rows"]]
        yield from ("", f"`{name}`, {record['about']}:", "")
        yield from markdown(
            (
                "method",
                *(f"{error}, %" for error in ERRORS.values()),
                "fit, s",
                "sample, µs",
                "settings",
            ),
            [
                (
                    row.method,
                    *(_marked(row, rows, error, label) for error, label in ERRORS.items()),
                    f"{row.fit_s:.2f}",
                    f"{row.sample_us:.2f}",
                    row.setting,
                )
                for row in sorted_rows(rows)
            ],
        )


def _marked(row: Row, rows: Sequence[Row], error: str, label: str) -> str:
    text = error_text(getattr(row, error))
    return f"**{text}**" if label in better_than_piezod(row, rows) else text


def soak() -> Iterator[str]:
    """Yield the table of a soak of one day."""
    numbers = _document("soak")
    return markdown(("", ""), [(label, f"{numbers[name]}") for name, label in SOAK.items()])


def _document(name: str) -> Any:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table; columns of numbers stand at the right."""
    right = (all(re.match(r"[-\d*]", row[i]) for row in rows) for i in range(len(columns)))
    yield f"| {' | '.join(columns)} |"
    yield f"| {' | '.join('--:' if each else '---' for each in right)} |"
    for row in rows:
        yield f"| {' | '.join(row)} |"
