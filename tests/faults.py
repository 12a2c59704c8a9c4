"""Runs the proofs of all faults: `python -m tests.faults` compares their times with the promises.

A proof is a test with the mark `fault(id)`, see `tests.fault_promises`. The command prints the
worst measured reaction to each fault, and writes it into the table of `docs/faults.md`. It fails if
a proof fails, if an id has no proof, or if a reaction takes longer than promised or was not
measured.
"""

import re
import sys
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import pytest

from tests.fault_promises import PAGE, PROMISES, PROVED, REACTION, ROW, Promise

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
        page = with_measured(PAGE.read_text(encoding="utf-8"), results)
        PAGE.write_text(page, encoding="utf-8")
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
    """Return a line for each id: promised and measured time, and the number of proofs."""
    rows = ((fault, each.bound, results.get(fault, Result())) for fault, each in PROMISES.items())
    return "\n".join(
        f"{fault:4} within {bound or '-':12} measured {worst or '-':>5}, proofs {proofs}"
        for fault, bound, (proofs, worst) in rows
    )


def with_measured(page: str, results: Mapping[str, Result]) -> str:
    """Return the page with the measured times in the table."""

    def written(row: re.Match[str]) -> str:
        if row["measured"] is None:
            return row[0]
        begin, end = (edge - row.start() for edge in row.span("measured"))
        return f"{row[0][:begin]}{results[row['id']].worst}{row[0][end:]}"

    return ROW.sub(written, page)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
