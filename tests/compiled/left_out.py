"""Leaves out what a compiled build refuses, and says why: `-p tests.compiled.left_out`.

Compiled classes take objects of the class that is declared, and no double of it; interpreted
classes cannot inherit from them; and nobody can replace their functions. A test that needs one of
these is skipped. Any other error, also of a type within the product, fails as ever.
"""

import re
import sys
from collections import Counter
from collections.abc import Generator
from typing import Any, Final

import pytest

REASONS: Final = {
    r"object expected; got (tests|piezod\.testing|benchmarks|unittest|types|conftest)\b": (
        "a double in place of a compiled class"
    ),
    r"interpreted classes cannot inherit from compiled": "a class derived from a compiled one",
    r"cannot (set|delete) '?\w+'? attribute of immutable type|is read-only|has no setter": (
        "a function of a compiled class replaced"
    ),
    r"object has no attribute '(__dict__|_\w+)'": "something private of a compiled class",
}
"""What is refused, as the errors tell it."""

_left_out: Counter[str] = Counter()
_replace: Final = pytest.MonkeyPatch.setattr


def pytest_configure() -> None:
    """Refuse to replace a function of a compiled class: compiled callers would not see it."""
    pytest.MonkeyPatch.setattr = _replace_visibly  # type: ignore[method-assign]


def _replace_visibly(self: pytest.MonkeyPatch, target: Any, *rest: Any, **options: Any) -> None:
    module = sys.modules.get(target.__module__) if isinstance(target, type) else None
    if module is not None and str(getattr(module, "__file__", "")).endswith(".so"):
        raise TypeError(f"cannot set {rest[0]!r} attribute of immutable type {target!r}")
    _replace(self, target, *rest, **options)


def reason_of(error: str) -> str | None:
    """Return why a test is left out that has failed with this error; None if it is not."""
    last = error.strip().splitlines()[-1] if error.strip() else ""
    return next((why for told, why in REASONS.items() if re.search(told, last)), None)


def _skip(report: Any, error: str) -> None:
    if report.failed and (why := reason_of(error)):
        report.outcome, report.longrepr = "skipped", ("compiled", 0, f"left out: {why}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,  # noqa: ARG001 - pytest's
    call: pytest.CallInfo[None],
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Skip a test that a compiled module refuses."""
    report = yield
    if call.excinfo is not None:
        _skip(report, f"{call.excinfo.value}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,  # noqa: ARG001 - pytest's
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Skip a file that cannot be imported, likewise."""
    report = yield
    if report.failed:
        _skip(report, str(report.longrepr))
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Count."""
    _count(report)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Count, but only where the tests are collected first."""
    _count(report)


def _count(report: Any) -> None:
    why = report.longrepr if report.skipped else None
    if isinstance(why, tuple | list) and why[0] == "compiled":  # a list from another process
        _left_out[report.longrepr[2]] += 1


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print how many are left out, by reason."""
    for why, number in _left_out.most_common():
        terminalreporter.write_line(f"{number} {why}")
