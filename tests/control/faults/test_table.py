"""Tests of the table of faults, and of the page that shows it."""

import re
from pathlib import Path

import pytest

from piezod.config.faults import Fault
from piezod.control.faults.cases import CASES, UNREACHABLE, Case, rule_of
from piezod.control.faults.table import (
    FAULTS,
    INDEX,
    Escalation,
    FaultRule,
    Latch,
    Reaction,
    Source,
    ids,
    mask,
)
from piezod.control.faults.unlisted import GAPS, NEVER_SHOWN
from piezod.units import NS_PER_S

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
ENDS = {Latch.L0: "itself", Latch.L1: "resume", Latch.L2: "reset", Latch.L3: "engineer"}
ROWS = re.findall(r"^\| ([A-Z]\d+) \| .*$", PAGE, re.MULTILINE)


def row_of(rule: FaultRule) -> str:
    """Return the row of a fault on the page."""
    reaction, end, worse = rule.reaction.name, ENDS[rule.latch], rule.escalation
    before: FaultRule | Escalation = rule
    while worse is not None:
        seconds = f"{worse.after_ns / NS_PER_S:g} s"
        when = seconds if worse.after_ns else f"{worse.cycles} cycles"
        if worse.reaction is not before.reaction:
            reaction += f", {worse.reaction.name} after {when}"
        if worse.latch is not before.latch:
            end += f", {ENDS[worse.latch]} after {when}"
        before, worse = worse, worse.then
    return f"| {rule.id} | {rule.name} | {reaction} | {end} | {rule.remedy} |"


@pytest.mark.parametrize("rule", FAULTS, ids=lambda rule: rule.id)
def test_page_shows_each_fault_as_in_the_table(rule: FaultRule) -> None:
    """The page has the name, the reaction, the latch and the remedy of each fault."""
    assert row_of(rule) in PAGE.splitlines()


def test_page_shows_each_fault_once_in_the_order_of_the_table() -> None:
    """Ids on the page that are not in the table are those that never reach the loop."""
    assert len(ROWS) == len(set(ROWS))
    assert [fault for fault in ROWS if fault in INDEX] == list(INDEX)


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


def test_page_has_the_reasons() -> None:
    """The lists of the page are those of the module, in their order."""
    section = PAGE.partition("### Not detected")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `([A-Z]\d+)` \| ([^|]*) \|$", section, re.MULTILINE)

    assert rows == [*NEVER_SHOWN.items(), *GAPS.items()]


def test_marks_of_tests_name_faults_on_the_page() -> None:
    """Each mark of a test names a fault that exists."""
    assert marked_ids() - set(ROWS) == set()


def test_each_fault_on_the_page_has_a_test() -> None:
    """Each id of the page is in the mark of a test, whether a module detects it or prevents it."""
    assert detected_ids() - set(ROWS) == set()
    assert set(ROWS) - marked_ids() == set()


def test_every_fault_has_one_row_and_fits_the_masks_of_a_record() -> None:
    """The rows have the order of the enumeration, which is that of the bits of two words."""
    assert [rule.id for rule in FAULTS] == list(Fault)
    assert len(FAULTS) <= 128


def test_page_shows_the_cases_with_other_rules() -> None:
    """The cases of a sensor share one row, because they have one reaction."""
    ends = [
        f"{rule.reaction.name}, RAMP after 1 s | resume, reset after 1 s"
        for (_, case), rule in CASES.items()
        if case is Case.SENSOR
    ]
    others = [
        (key, rule) for key, rule in CASES.items() if key[1] not in {Case.SENSOR, Case.SINGLE}
    ]

    assert f"| {', '.join(UNREACHABLE)} of a sensor | as above | {ends[0]} | as above |" in PAGE
    assert len(set(ends)) == 1
    for (fault, case), rule in others:
        assert f"| {fault}: {case.value} {row_of(rule).removeprefix(f'| {fault} ')}" in PAGE


@pytest.mark.parametrize(("fault", "case"), CASES)
def test_case_has_another_reaction_or_latch_than_its_fault(fault: Fault, case: Case) -> None:
    """A case keeps the id of its fault and differs in reaction or latch."""
    usual, other = rule_of(fault, Case.USUAL), rule_of(fault, case)

    assert other.id == usual.id == fault
    assert (other.reaction, other.latch) != (usual.reaction, usual.latch)


@pytest.mark.parametrize("rule", [*FAULTS, *CASES.values()], ids=lambda rule: rule.id)
def test_each_rule_is_consistent(rule: FaultRule) -> None:
    """Faults that stop the stage are latched, except for lateness; escalations are worse."""
    letter = {"S": Source.SENSOR, "A": Source.AMPLIFIER, "B": Source.BUS, "L": Source.LOOP}
    assert rule.source is {**letter, "D": Source.ADAPTATION}.get(rule.id[0], Source.PROCESS)
    assert (rule.severity == "error") >= (rule.reaction >= Reaction.HOLD)
    ends_by_itself = rule.id is Fault.L2 and rule.reaction is Reaction.HOLD
    assert (rule.latch >= Latch.L1 or ends_by_itself) >= (rule.reaction >= Reaction.HOLD)
    assert (rule.severity != "info") >= (rule.latch >= Latch.L1)
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
