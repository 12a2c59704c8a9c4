"""Each reaction is compared with the promise of the page for its fault."""

from typing import Literal

import pytest

from tests.conftest import Reaction
from tests.fault_promises import PROMISES, PROVED, REACTION
from tests.faults import Result, problems, results_of, with_measured

PAGE = """
| id | noticed | done | within (measured) |
| S2 | not a number | HOLD; resume | 5 cycles (4) |
| L3 | hung | killed | 2500 ms () beyond the ramp |
| C1 | malformed | refused | |
"""


def report(passed: bool, *properties: tuple[str, object]) -> pytest.TestReport:
    """Return the report of a test."""
    told: Literal["passed", "failed"] = "passed" if passed else "failed"
    return pytest.TestReport("", ("", 0, ""), {}, told, None, "call", user_properties=properties)


def kept() -> dict[str, Result]:
    """Return results that keep each promise exactly."""
    return {fault: Result(1, each.limit) for fault, each in PROMISES.items()}


def test_measured_times_are_written_where_a_time_is_promised() -> None:
    """The rest of the page stays."""
    written = with_measured(PAGE, {"S2": Result(1, 3), "L3": Result(1, 2100), "C1": Result(1)})

    assert written == PAGE.replace("(4)", "(3)").replace("()", "(2100)")


def test_worst_reaction_of_passed_proofs_counts() -> None:
    """A test that failed proves nothing, and a test proves what its marks name only."""
    reports = [
        report(True, (PROVED, "S2"), (REACTION, ["S2", 3])),
        report(True, (PROVED, "S2"), (REACTION, ["S2", 4]), (REACTION, ["S5", 7])),
        report(True, (PROVED, "S2")),
        report(False, (PROVED, "S2"), (REACTION, ["S2", 9]), (PROVED, "S3")),
    ]

    assert results_of(reports) == {"S2": Result(3, 4)}


def test_each_gap_is_a_problem() -> None:
    """No proof, no measured time, and a time beyond the promise are told."""
    results = kept() | {"S1": Result(), "S2": Result(1), "S3": Result(1, 5), "S4": Result(1)}

    assert problems(kept()) == []
    assert problems(results) == [
        'S1: no proof has passed: mark a test with `pytest.mark.fault("ID")`',
        "S2: no proof has measured its reaction (5 cycles are promised)",
        "S3: 5 of 4 cycles: too late",
    ]


def test_reaction_beyond_its_cycles_fails(reaction: Reaction) -> None:
    """Virtual time is compared in each test run; a wall clock by the command only."""
    reaction("L3", ms=10**9)

    with pytest.raises(AssertionError, match="S2: 6 of 5 cycles"):
        reaction("S2", cycles=6)


def test_reaction_before_its_cause_fails(reaction: Reaction) -> None:
    """A time that is not positive is no reaction: the first cycle has number 1."""
    with pytest.raises(AssertionError, match="S2: a reaction in cycle 0 has another cause"):
        reaction("S2", cycles=0)
    with pytest.raises(AssertionError, match="L3: a reaction after -1 ms has another cause"):
        reaction("L3", ms=-1.0)
