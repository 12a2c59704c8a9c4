"""The faults, from the table of faults."""

from collections.abc import Iterator

from docs.site.reference.text import code, sentence, table
from piezod.control.faults.cases import CASES, Case
from piezod.control.faults.table import FAULTS, Escalation, FaultRule, FaultSource, Latch
from piezod.control.faults.unlisted import GAPS, NEVER_SHOWN
from piezod.devices import registry
from piezod.units import NS_PER_S

ENDS = {
    Latch.ITSELF: "itself",
    Latch.RESUME: "resume",
    Latch.RESET: "reset",
    Latch.ENGINEER: "engineer",
}
"""Words of the page for what ends a fault."""


def page() -> Iterator[str]:
    """Yield the page."""
    yield "# Table of faults"
    yield ""
    yield "[Faults](../faults.md) explains the reactions, and what ends a fault."
    drivers = {name: registry.load(name).sees for name in registry.names()}
    for source in FaultSource:
        yield f"\n## {source.name.capitalize()}\n"
        for rule in FAULTS:
            if rule.source is source:
                yield from _fault(
                    rule, [code(name) for name in drivers if rule.id in drivers[name]]
                )


def _fault(rule: FaultRule, drivers: list[str]) -> Iterator[str]:
    yield f"\n### {rule.id} {rule.name} {{ #{rule.id.lower()} }}\n"
    rows = [("severity", rule.severity), ("reaction", reaction(rule)), ("ends with", ends(rule))]
    others = [(case, each) for (fault, case), each in CASES.items() if fault is rule.id]
    for case, each in others:
        if case is not Case.SINGLE:
            rows.append((f"reaction: {case.value}", f"{reaction(each)}; ends with {ends(each)}"))
    rows.append(("what to do", sentence(rule.remedy)))
    if rule.id in NEVER_SHOWN:
        rows.append(("never shown", NEVER_SHOWN[rule.id]))
    if rule.id in GAPS:
        rows.append(("not detected", GAPS[rule.id]))
    if drivers:
        rows.append(("drivers that detect it", ", ".join(drivers)))
    yield from table(("", ""), rows)


def reaction(rule: FaultRule) -> str:
    """Return the reaction, and the worse ones that follow if the fault stays."""
    text, present = rule.reaction.name, rule.reaction
    for step in _steps(rule):
        if step.reaction is not present:
            text, present = f"{text}, {step.reaction.name} after {_when(step)}", step.reaction
    return text


def ends(rule: FaultRule) -> str:
    """Return what ends the fault, now and when it has stayed."""
    text, present = ENDS[rule.latch], rule.latch
    for step in _steps(rule):
        if step.latch is not present:
            text, present = f"{text}, {ENDS[step.latch]} after {_when(step)}", step.latch
    return text


def _steps(rule: FaultRule) -> Iterator[Escalation]:
    step = rule.escalation
    while step is not None:
        yield step
        step = step.then


def _when(step: Escalation) -> str:
    return f"{step.after_ns / NS_PER_S:g} s" if step.after_ns else f"{step.cycles} cycles"
