"""Runs the proofs of all faults: `python -m tests.faults` compares their times with the promises.

A proof is a test with the mark `fault(id)`, see `tests.fault_promises`. The command prints the
worst measured reaction to each fault, and writes the table into `docs/faults.md`. It fails if a
proof fails, if an id has no proof, or if a reaction takes longer than promised or was not measured.
"""

import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest

from tests.fault_promises import PROMISES, PROVED, REACTION, Promise, in_words

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "faults.md"
BEGIN: Final = "<!-- promises, begin -->\n"
END: Final = "<!-- promises, end -->\n"
HEAD: Final = "| id | promise | within | measured |\n|---|---|---|---|\n"
_ROW: Final = re.compile(r"^\| `(\w+)` \| (.*) \| (.*) \| .* \|$", re.MULTILINE)
_CHOSEN: Final = "fault and not (stress or hardware or realtime or peers or browser or docs)"


class Reports:
    """A plugin of pytest that keeps the report of each test."""

    def __init__(self) -> None:
        self.all: list[pytest.TestReport] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the report of the test itself."""
        if report.when == "call":
            self.all.append(report)


class Result(NamedTuple):
    """What the proofs of one id have shown."""

    proofs: int = 0  #: Number of tests that passed, each with its parameters.
    #: Longest measured reaction, in cycles or ms as its bound; None if none was measured.
    worst: int | None = None


def main(arguments: list[str]) -> int:
    """Run the proofs; return the exit code. The arguments go to pytest."""
    reports = Reports()
    code = int(pytest.main(["-m", _CHOSEN, *arguments], [reports]))
    results = results_of(reports.all)
    print(as_text(results))
    wrong = problems(results)
    for each in wrong:
        print(each)
    if not (code or wrong):
        write(results)
    return code or bool(wrong)


def results_of(reports: list[pytest.TestReport]) -> dict[str, Result]:
    """Return the results of all ids, from the reports of the tests that passed.

    The reaction to a fault that a test does not prove, by its mark, does not count.
    """
    results: dict[str, Result] = {}
    for report in reports:
        properties = report.user_properties if report.passed else []
        measured: list[Any] = [value for name, value in properties if name == REACTION]
        for fault in {str(value) for name, value in properties if name == PROVED}:
            proofs, worst = results.get(fault, Result())
            times = [time for each, time in measured if each == fault]
            worst = max((*times, *(() if worst is None else (worst,))), default=None)
            results[fault] = Result(proofs + 1, worst)
    return results


def problems(results: Mapping[str, Result]) -> list[str]:
    """Return what the proofs lack, or which reactions take longer than promised."""
    return [
        f"{fault}: {problem}"
        for fault, promise in PROMISES.items()
        if (problem := _problem(promise, results.get(fault, Result())))
    ]


def _problem(promise: Promise, result: Result) -> str:
    if not result.proofs:
        return 'no proof has passed: mark a test with `pytest.mark.fault("ID")`'
    if promise.limit is None:
        return ""
    if result.worst is None:
        return f"no proof has measured its reaction ({promise.bound} are promised)"
    return f"{result.worst} of {promise.bound}: too late" if result.worst > promise.limit else ""


def as_text(results: Mapping[str, Result]) -> str:
    """Return the table, in columns."""
    head = ("id", "promise", "within", "measured", "proofs")
    proofs = [str(results.get(fault, Result()).proofs) for fault in PROMISES]
    rows = [head, *((*row, count) for row, count in zip(_rows(results), proofs, strict=True))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def section(results: Mapping[str, Result]) -> str:
    """Return the table of the page."""
    lines = [f"| `{row[0]}` | {' | '.join(row[1:])} |\n" for row in _rows(results)]
    return HEAD + "".join(lines)


def _rows(results: Mapping[str, Result]) -> Iterator[tuple[str, ...]]:
    for fault, promise in PROMISES.items():
        result = results.get(fault, Result())
        measured = "" if result.worst is None else in_words(result.worst, promise.unit)
        yield fault, promise.what, promise.bound, measured


def write(results: Mapping[str, Result]) -> None:
    """Write the table into the page."""
    before, after = _around(PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(f"{before}{BEGIN}{section(results)}{END}{after}", encoding="utf-8")


def promises_on_the_page() -> list[tuple[str, ...]]:
    """Return id, promise and bound of each row of the page."""
    text = PAGE.read_text(encoding="utf-8")
    before, after = _around(text)
    return _ROW.findall(text.removeprefix(before).removesuffix(after))


def _around(text: str) -> tuple[str, str]:
    """Return the text of the page before and after the table."""
    before, _, rest = text.partition(BEGIN)
    return before, rest.partition(END)[2]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
