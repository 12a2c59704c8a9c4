"""Tests of the table of faults, and of the page that shows it."""

import re
from pathlib import Path

import pytest

from docs.site.reference.faults import ends, reaction
from piezod.config.faults import Fault
from piezod.control.faults.cases import CASES, UNREACHABLE, Case, rule_of
from piezod.control.faults.table import (
    FAULTS,
    INDEX,
    FaultRule,
    FaultSource,
    Latch,
    Reaction,
    ids,
    mask,
)
from piezod.control.faults.unlisted import GAPS, NEVER_SHOWN
from tests.fault_promises import PAGE, PROMISES

ROOT = Path(__file__).parents[3]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")][:3]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if re.match(r"\| [A-Z]\d+.* \| .* \| .* \| .*\|$", line)
]
"""The rows of the page: id and case, what is noticed, what is done."""


def row_of(fault: Fault, case: Case = Case.USUAL) -> list[str]:
    """Return the row of a fault, or of another case of it."""
    rule = rule_of(fault, case)
    done = f"{reaction(rule)}; {ends(rule)}"
    if case is Case.USUAL:
        return [fault, rule.name, "never shown" if fault in NEVER_SHOWN else done]
    same = rule.name == rule_of(fault, Case.USUAL).name
    return [f"{fault}: {case}", "as above" if same else rule.name, done]


def test_page_shows_each_fault_and_case_as_in_the_table() -> None:
    """The page has name, reaction and latch; cases of a sensor share one row."""
    shared = f"{', '.join(UNREACHABLE)} of a sensor"
    cases = [key for key in CASES if key[1] is not Case.SINGLE]
    rows = [*map(row_of, Fault), *(row_of(*key) for key in cases)]
    rows = [[shared, *row[1:]] if row[0].endswith(": of a sensor") else row for row in rows]

    assert [row for row in rows if row not in ROWS] == []


def test_page_has_one_row_for_each_id() -> None:
    """Other rows have no id of their own, and each id is a promise."""
    found = [id_ for id_, *_ in ROWS if re.fullmatch(r"[A-Z]\d+", id_)]

    assert found == list(PROMISES)
    assert set(INDEX) <= set(found)


def detected_ids() -> set[str]:
    """Return the ids that modules name, other than the table and the list of the others."""
    folder = ROOT / "piezod" / "control" / "faults"
    lists = {folder / "table.py", folder / "unlisted.py"}
    modules = [path for path in (ROOT / "piezod").rglob("*.py") if path not in lists]
    return set(
        re.findall(r"Fault\.([A-Z]\d+)", "\n".join(path.read_text("utf-8") for path in modules))
    )


def marked_ids() -> set[str]:
    """Return the ids in the marks of tests, or in their tables of cases."""
    marks = re.compile(r'(?:mark\.fault|Case)\("([A-Z]\d+)"')
    tests = (ROOT / "tests").rglob("test_*.py")
    return {fault for path in tests for fault in marks.findall(path.read_text("utf-8"))}


def test_reason_is_given_for_the_faults_that_no_module_detects() -> None:
    """A fault that only the table names has a reason, and no other fault has one."""
    assert set(Fault) - detected_ids() == set(NEVER_SHOWN)
    assert GAPS.keys() & NEVER_SHOWN.keys() == set()


def test_marks_of_tests_name_faults_on_the_page() -> None:
    """Each mark of a test names a fault that exists."""
    assert marked_ids() - PROMISES.keys() == set()


def test_each_fault_on_the_page_has_a_test() -> None:
    """Each id of the page is in the mark of a test, whether a module detects it or prevents it."""
    assert detected_ids() - PROMISES.keys() == set()
    assert PROMISES.keys() - marked_ids() == set()


def test_every_fault_has_one_row_and_fits_the_masks_of_a_record() -> None:
    """The rows have the order of the enumeration, which is that of the bits of two words."""
    assert [rule.id for rule in FAULTS] == list(Fault)
    assert len(FAULTS) <= 128


@pytest.mark.parametrize(("fault", "case"), CASES)
def test_case_has_another_reaction_or_latch_than_its_fault(fault: Fault, case: Case) -> None:
    """A case keeps the id of its fault and differs in reaction or latch."""
    usual, other = rule_of(fault, Case.USUAL), rule_of(fault, case)

    assert other.id == usual.id == fault
    assert (other.reaction, other.latch) != (usual.reaction, usual.latch)


@pytest.mark.parametrize("rule", [*FAULTS, *CASES.values()], ids=lambda rule: rule.id)
def test_each_rule_is_consistent(rule: FaultRule) -> None:
    """Faults that stop the stage are latched, except for lateness; escalations are worse."""
    letters = {"S": "SENSOR", "A": "AMPLIFIER", "B": "BUS", "L": "LOOP", "D": "ADAPTATION"}
    assert rule.source is FaultSource[letters.get(rule.id[0], "PROCESS")]
    assert (rule.severity == "error") >= (rule.reaction >= Reaction.HOLD)
    ends_by_itself = rule.id is Fault.L2 and rule.reaction is Reaction.HOLD
    assert (rule.latch >= Latch.RESUME or ends_by_itself) >= (rule.reaction >= Reaction.HOLD)
    assert (rule.severity != "info") >= (rule.latch >= Latch.RESUME)
    assert "|" not in rule.name + rule.remedy
    assert rule.name
    assert rule.remedy
    if rule.escalation is not None:
        assert rule.latch  # the register latches a fault when it appears
        worse = (rule.escalation.reaction, rule.escalation.latch)
        assert worse > (rule.reaction, rule.latch)
        assert rule.escalation.latch >= rule.latch


def test_mask_and_ids_are_inverse() -> None:
    """Masks and ids convert into each other for one fault, for all and for none."""
    everything = [rule.id for rule in FAULTS]

    assert mask([Fault.S1]) == 1
    assert ids(mask(everything)) == everything
    assert (mask([]), ids(0)) == (0, [])
    assert ids(mask([Fault.D1, Fault.S5])) == [Fault.S5, Fault.D1]
