"""Which faults are present and latched, which are consequences of others, and what to do now."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case, rule_of
from piezod.control.faults.table import (
    FAULTS,
    INDEX,
    FaultRule,
    Latch,
    Reaction,
    Source,
    mask,
)

GOOD_CYCLES: Final = 20
"""A fault is gone after so many cycles in a row in which no watch finds it."""
CAUSE_CYCLES: Final = 10
"""For so many cycles after it appeared, a fault is taken for the cause of others."""
_TRIPPED: Final = mask([Fault.A9])
_DEGRADING: Final = mask(
    rule.id
    for rule in FAULTS
    if Reaction.DEGRADE in (rule.reaction, rule.escalation and rule.escalation.reaction)
)


class Detection(NamedTuple):
    """A fault that a watch finds in this cycle; it is told in every cycle in which it is there.

    Attributes:
        fault: Which fault.
        axis: Index of the axis, -1 where it concerns all.
        measured: The value that was found, NaN where there is none.
        limit: What it was compared with, NaN where there is none.
        case: Which case of it.
    """

    fault: Fault
    axis: int = -1
    measured: float = float("nan")
    limit: float = float("nan")
    case: Case = Case.USUAL


class News(NamedTuple):
    """A fault that came, became worse, or went.

    Attributes:
        rule: What holds for it now; after an escalation with the worse reaction and latch.
        detection: Where it was found last.
        appeared: Whether it came or became worse; else it is gone, and no longer latched.
    """

    rule: FaultRule
    detection: Detection
    appeared: bool


class FaultRegister:
    """Remembers faults from cycle to cycle; deterministic, fixed memory.

    Args:
        reset_after_cycles: For how many cycles a fault must be gone before `reset` drops it.
    """

    def __init__(self, reset_after_cycles: int) -> None:
        self._reset_after_cycles = max(reset_after_cycles, GOOD_CYCLES)
        self.present = 0
        """Faults that are there, as bits: found in one of the last cycles."""
        self.latched = 0
        """Faults that only somebody ends, as bits."""
        self.news: list[News] = []
        """What the last `update` brought, and what was dropped since the one before."""
        self._dropped: list[News] = []
        self._cycle = 0
        self._rules = list(FAULTS)
        self._last = [Detection(rule.id) for rule in FAULTS]
        self._seen_cycle = [0] * len(FAULTS)
        self._since_cycle = [0] * len(FAULTS)
        self._since_ns = [0] * len(FAULTS)
        self._axes = [0] * len(FAULTS)
        self._cause_until = [[-1] * len(Reaction) for _ in Source]

    def update(self, detections: Sequence[Detection], t_ns: int) -> Reaction:
        """Take what the watches found in this cycle; call it once in each, in the loop.

        Returns:
            The worst reaction to what is new: it appeared, it became worse, or it came to another
            axis. A second HOLD from the same source is not new: it is the same trouble.
        """
        self._cycle += 1
        if self.news:
            self.news.clear()
        if self._dropped:
            self.news += self._dropped
            self._dropped.clear()
        if not (detections or self.present):
            return Reaction.NONE
        worst = Reaction.NONE
        for detection in sorted(detections, key=_source) if len(detections) > 1 else detections:
            worst = max(worst, self._take(detection, t_ns))
        for index in _places(self.present):
            if self._cycle - self._seen_cycle[index] >= GOOD_CYCLES:
                self._gone(index)
        return worst

    @property
    def unreachable(self) -> bool:
        """Whether a fault is present that makes an amplifier unreachable.

        A watchdog that has tripped does not: many tell so until they take a write.
        """
        places = _places(self.present & ~_TRIPPED)
        return any(self._rules[index].reaction is Reaction.BLIND for index in places)

    def axes_of(self, fault: Fault) -> int:
        """Return the axes on which a fault was found since it is present or latched, as bits."""
        return self._axes[INDEX[fault]]

    @property
    def adapt_allowed(self) -> bool:
        """Whether no fault that is present or latched forbids to adapt."""
        bits = (self.present | self.latched) & _DEGRADING
        return not any(self._rules[index].reaction >= Reaction.DEGRADE for index in _places(bits))

    @property
    def blocking(self) -> int:
        """Latched faults that stop the stage and that only `reset` ends, as bits."""
        return self._select(self.latched, Latch.L2)

    @property
    def no_entry(self) -> str:
        """Why nothing may be started: the worst fault that stops the stage; empty: it may."""
        return self._why(self._select(self.latched, Latch.L1))

    def resume(self) -> str:
        """Drop what is latched until `resume` and gone; return why not, empty where done."""
        stopping = self._select(self.present, Latch.L1) | self.blocking
        if not stopping:
            for index in _places(self.latched & ~self.present):
                if self._rules[index].latch is Latch.L1:
                    self._drop(index)
        return self._why(stopping)

    def reset(self, engineer: bool) -> str:
        """Drop all that is latched and may be dropped.

        Args:
            engineer: Whether an engineer asks for it.

        Returns:
            Why the stage stays stopped, or why nothing was dropped; empty where it is done.
        """
        before = self.latched
        for index in _places(before):
            latch = self._rules[index].latch
            wait = GOOD_CYCLES if latch is Latch.L1 else self._reset_after_cycles
            gone = self._cycle - self._seen_cycle[index] >= wait
            if gone and (latch < Latch.L3 or engineer):
                self._drop(index)
        stopping = self._select(self.latched, Latch.L1)
        return self._why(stopping or (self.latched if self.latched == before else 0))

    def _take(self, detection: Detection, t_ns: int) -> Reaction:
        index, rule = INDEX[detection.fault], rule_of(detection.fault, detection.case)
        if self.latched >> index & 1 and not rule.latch:
            return Reaction.NONE  # what is only counted does not keep a fault from being over
        self._seen_cycle[index] = self._cycle
        axis = 1 << detection.axis if detection.axis >= 0 else -1
        if not self.present >> index & 1 or rule.reaction > self._rules[index].reaction:
            return self._appear(index, axis, rule, detection, t_ns)
        self._last[index] = detection
        if axis & ~self._axes[index]:
            self._axes[index] |= axis
            self.news.append(News(self._rules[index], detection, True))
            return self._unless_held(index, self._rules[index])
        return self._stay(index, detection, t_ns)

    def _appear(
        self, index: int, axis: int, rule: FaultRule, detection: Detection, t_ns: int
    ) -> Reaction:
        if self._is_consequence(rule):
            return Reaction.NONE
        latched = self.latched >> index & 1
        if latched:  # it comes back: as at first, but what ends it is what it was
            rule = rule._replace(latch=max(rule.latch, self._rules[index].latch))
        reaction = self._unless_held(index, rule)
        self._rules[index], self._last[index] = rule, detection
        self._axes[index] = axis | (self._axes[index] if latched else 0)
        self._since_cycle[index], self._since_ns[index] = self._cycle, t_ns
        self._cause_until[rule.source][rule.reaction] = self._cycle + CAUSE_CYCLES
        self.present |= 1 << index
        if rule.latch:
            self.latched |= 1 << index
        self.news.append(News(rule, detection, True))
        return reaction

    def _stay(self, index: int, detection: Detection, t_ns: int) -> Reaction:
        rule = self._rules[index]
        worse = rule.escalation
        if (
            worse is None
            or self._cycle - self._since_cycle[index] < worse.cycles
            or t_ns - self._since_ns[index] < worse.after_ns
        ):
            return Reaction.NONE
        rule = rule._replace(reaction=worse.reaction, latch=worse.latch, escalation=worse.then)
        reaction = self._unless_held(index, rule)
        self._rules[index] = rule
        self.latched |= 1 << index
        self.news.append(News(rule, detection, True))
        return reaction

    def _is_consequence(self, rule: FaultRule) -> bool:
        """Tell whether a cause has appeared lately that is reacted to at least as strictly."""
        if rule.source is Source.PROCESS:
            return False
        return any(
            max(self._cause_until[source][rule.reaction :]) >= self._cycle
            for source in range(rule.source)
        )

    def _unless_held(self, index: int, rule: FaultRule) -> Reaction:
        """Return a reaction, unless it is a HOLD that is no new trouble.

        Its source already has one, or what follows from it was found a little earlier.
        """
        if rule.reaction is Reaction.HOLD:
            for other in _places(self.present & ~(1 << index)):
                held = self._rules[other]
                if held.reaction >= Reaction.HOLD and (
                    held.source is rule.source or self._followed(rule, other)
                ):
                    return Reaction.NONE
            if self.present >> index & 1 and self._rules[index].reaction >= Reaction.HOLD:
                return Reaction.NONE
        return rule.reaction

    def _followed(self, rule: FaultRule, other: int) -> bool:
        """Tell whether another fault, found a little earlier, is a consequence of one."""
        source = self._rules[other].source
        lately = self._cycle - self._since_cycle[other] <= CAUSE_CYCLES
        return lately and rule.source < source < Source.PROCESS

    def _gone(self, index: int) -> None:
        self.present &= ~(1 << index)
        if not self.latched >> index & 1:
            self._axes[index] = 0
            self.news.append(News(self._rules[index], self._last[index], False))

    def _drop(self, index: int) -> None:
        self.latched &= ~(1 << index)
        self._axes[index] = 0
        self._dropped.append(News(self._rules[index], self._last[index], False))

    def _select(self, bits: int, latch: Latch) -> int:
        """Return those of some faults that stop the stage and are latched at least so."""
        selected = 0
        for index in _places(bits):
            rule = self._rules[index]
            if rule.reaction >= Reaction.HOLD and rule.latch >= latch:
                selected |= 1 << index
        return selected

    def _why(self, bits: int) -> str:
        """Return what the worst of some faults is and what ends it; empty where there is none."""
        if not bits:
            return ""
        index = max(_places(bits), key=lambda place: self._rules[place].reaction)
        rule = self._rules[index]
        if self.present >> index & 1:
            return f"{rule.id} is present: {rule.name}; {rule.remedy}"
        who = "an engineer's `piezod reset`" if rule.latch is Latch.L3 else "`piezod reset`"
        return (
            f"{rule.id} was found: {rule.name}; {rule.remedy}; "
            f"{who} ends it once it has been gone for a second"
        )


def _source(detection: Detection) -> Source:
    return FAULTS[INDEX[detection.fault]].source


def _places(bits: int) -> Iterator[int]:
    """Go through the places of the bits that are set."""
    while bits:
        lowest = bits & -bits
        yield lowest.bit_length() - 1
        bits ^= lowest
