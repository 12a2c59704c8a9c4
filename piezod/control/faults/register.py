"""The register of the faults that are present or latched.

It separates causes from consequences and returns the reaction of each cycle.
"""

from collections.abc import Iterator, Sequence
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.cases import CASES, rule_of
from piezod.control.faults.detection import Detection, News
from piezod.control.faults.table import FAULTS, INDEX, FaultRule, FaultSource, Latch, Reaction, mask

GOOD_CYCLES: Final = 20
"""A fault is gone after this many cycles in a row without a detection."""
CAUSE_CYCLES: Final = 10
"""For this many cycles after it appeared, a fault counts as the cause of others."""
_TRIPPED: Final = mask([Fault.A9])
_DEGRADING: Final = mask(
    rule.id
    for rule in (*FAULTS, *CASES.values())
    if Reaction.DEGRADE in (rule.reaction, rule.escalation and rule.escalation.reaction)
)


class FaultRegister:
    """Keeps faults from cycle to cycle. Deterministic, fixed memory, real-time safe.

    Args:
        reset_after_cycles: Cycles that a fault must be gone before `reset` drops it.
    """

    def __init__(self, reset_after_cycles: int) -> None:
        self._reset_after_cycles = max(reset_after_cycles, GOOD_CYCLES)
        self.present = 0
        """Bit mask of the present faults: detected in one of the last cycles."""
        self.latched = 0
        """Bit mask of the latched faults: only a request ends them."""
        self.news: list[News] = []
        """Changes of the last `update`, and faults that were dropped since the one before."""
        self._dropped: list[News] = []
        self._cycle = 0
        self._rules = list(FAULTS)
        self._last = [Detection(rule.id) for rule in FAULTS]
        self._seen_cycle, self._since_cycle, self._since_ns, self._axes = (
            [0] * len(FAULTS) for _ in range(4)
        )
        # For each source and reaction: the last cycle in which such a fault still counts as a
        # cause.
        self._cause_until_cycle = [[0] * len(Reaction) for _ in FaultSource]

    def update(self, detections: Sequence[Detection], t_ns: int) -> Reaction:
        """Take the detections of this cycle. Call once per cycle.

        Returns:
            The most severe reaction to a fault that appeared, escalated, or reached another axis. A
            second HOLD from the same source is not included: it has the same cause.
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
        # Causes first: consequences are then suppressed in the same cycle.
        for detection in sorted(detections, key=_source):
            worst = max(worst, self._add(detection, t_ns))
        for index in _positions(self.present):
            # A fault ends late, so that one that flickers neither ends nor reacts again each time.
            if self._cycle - self._seen_cycle[index] >= GOOD_CYCLES:
                self._end(index)
        return worst

    @property
    def unreachable(self) -> int:
        """Axes whose amplifier a present fault makes unreachable, as a bit mask.

        A tripped watchdog does not: many amplifiers report it until they take a write.
        """
        # After a trip the amplifier waits for a write: waiting for its flag to clear would be a
        # deadlock.
        return self._blind(self.present & ~_TRIPPED)

    @property
    def blind(self) -> int:
        """Axes with a present fault that makes the stage blind, as a bit mask."""
        return self._blind(self.present)

    def _blind(self, faults: int) -> int:
        axes = 0
        for index in _positions(faults):
            if self._rules[index].reaction is Reaction.BLIND:
                axes |= self._axes[index]
        return axes

    def axes_of(self, fault: Fault) -> int:
        """Return the axes of a fault that is present or latched, as a bit mask."""
        return self._axes[INDEX[fault]]

    @property
    def adapt_allowed(self) -> bool:
        """Whether no present or latched fault forbids adaptation."""
        bits = (self.present | self.latched) & _DEGRADING
        return not any(
            self._rules[index].reaction >= Reaction.DEGRADE for index in _positions(bits)
        )

    @property
    def blocking(self) -> int:
        """Bit mask of the latched faults that stop the stage and that only `reset` ends."""
        return self._select(self.latched, Latch.RESET)

    @property
    def stopping(self) -> int:
        """Bit mask of the present and latched faults that stop the stage."""
        return self._select(self.present | self.latched, Latch.ITSELF)

    @property
    def needs_person(self) -> bool:
        """Whether one of the faults that stop the stage does not end by itself."""
        return bool(self._select(self.present | self.latched, Latch.RESUME))

    @property
    def no_entry(self) -> str:
        """Most severe fault that stops the stage, as a text; empty if there is none."""
        return self._describe_worst(self.stopping)

    def resume(self) -> str:
        """Drop the faults that `resume` ends and that are gone; return why not, empty if done."""
        stopping = self._select(self.present, Latch.ITSELF) | self.blocking
        if not stopping:
            for index in _positions(self.latched & ~self.present):
                if self._rules[index].latch is Latch.RESUME:
                    self._drop(index)
        return self._describe_worst(stopping)

    def reset(self, engineer: bool) -> str:
        """Drop all latched faults that may be dropped.

        Args:
            engineer: Whether an engineer requests it.

        Returns:
            Why the stage remains stopped, or why nothing was dropped; empty if done.
        """
        before = self.latched
        for index in _positions(before):
            latch = self._rules[index].latch
            # `resume` would have ended these after GOOD_CYCLES, so `reset` does not wait longer.
            wait = GOOD_CYCLES if latch is Latch.RESUME else self._reset_after_cycles
            gone = self._cycle - self._seen_cycle[index] >= wait
            if gone and (latch < Latch.ENGINEER or engineer):
                self._drop(index)
        stopping = self._select(self.latched, Latch.RESUME)
        return self._describe_worst(stopping or (self.latched if self.latched == before else 0))

    def restore(self, latched: int, *, stopped: bool) -> None:
        """Latch the faults of the loop before; if they had stopped the stage, as escalated ones."""
        self.latched |= latched
        for index in _positions(latched):
            rule, self._axes[index] = self._rules[index], -1  # the axes are not known any more
            if stopped and rule.escalation is not None:
                worse = rule.escalation
                rule = rule._replace(reaction=worse.reaction, latch=max(rule.latch, worse.latch))
            self._rules[index] = rule

    def _add(self, detection: Detection, t_ns: int) -> Reaction:
        """Add one detection; return its reaction."""
        index, rule = INDEX[detection.fault], rule_of(detection.fault, detection.case)
        if self.latched >> index & 1 and not rule.latch:
            return Reaction.NONE  # single events do not keep a latched fault present
        self._seen_cycle[index] = self._cycle
        # A fault that concerns all axes sets all bits.
        axis = 1 << detection.axis if detection.axis >= 0 else -1
        if not self.present >> index & 1 or rule.reaction > self._rules[index].reaction:
            return self._appear(index, axis, rule, detection, t_ns)
        self._last[index] = detection
        if axis & ~self._axes[index]:
            self._axes[index] |= axis
            self.news.append(News(self._rules[index], detection, True))
            return self._without_repeated_hold(self._rules[index])
        return self._escalate(index, detection, t_ns)

    def _appear(
        self, index: int, axis: int, rule: FaultRule, detection: Detection, t_ns: int
    ) -> Reaction:
        """Register a fault that was not present, or whose case is more severe now."""
        # It is not stored: if it outlasts its cause, it appears then, with its own reaction.
        if self._is_consequence(rule):
            return Reaction.NONE
        latched = self.latched >> index & 1
        if latched:  # it returns: first reaction, but the latch it had
            rule = rule._replace(latch=max(rule.latch, self._rules[index].latch))
        reaction = self._without_repeated_hold(rule)
        self._rules[index], self._last[index] = rule, detection
        self._axes[index] = axis | (self._axes[index] if latched else 0)
        self._since_cycle[index], self._since_ns[index] = self._cycle, t_ns
        self._cause_until_cycle[rule.source][rule.reaction] = self._cycle + CAUSE_CYCLES
        self.present |= 1 << index
        if rule.latch:
            self.latched |= 1 << index
        self.news.append(News(rule, detection, True))
        return reaction

    def _escalate(self, index: int, detection: Detection, t_ns: int) -> Reaction:
        """Apply the escalation of a fault that has stayed long enough."""
        rule = self._rules[index]
        escalation = rule.escalation
        if (
            escalation is None
            or self._cycle - self._since_cycle[index] < escalation.cycles
            or t_ns - self._since_ns[index] < escalation.after_ns
        ):
            return Reaction.NONE
        rule = rule._replace(
            reaction=escalation.reaction, latch=escalation.latch, escalation=escalation.then
        )
        reaction = self._without_repeated_hold(rule)
        self._rules[index] = rule
        self.news.append(News(rule, detection, True))
        return reaction

    def _is_consequence(self, rule: FaultRule) -> bool:
        """Return whether a cause with at least as severe a reaction has appeared recently."""
        if rule.source is FaultSource.PROCESS:
            return False
        return any(
            # Only causes with at least the same reaction: a mild one must not hide a severe
            # consequence.
            max(self._cause_until_cycle[source][rule.reaction :]) >= self._cycle
            for source in range(rule.source)
        )

    def _without_repeated_hold(self, rule: FaultRule) -> Reaction:
        """Return the reaction, or NONE if it is a HOLD that is already in effect.

        That is so if the same source already holds the stage, or if a consequence of this fault was
        found a little earlier.
        """
        if rule.reaction is Reaction.HOLD:
            for other in _positions(self.present):
                held = self._rules[other]
                if held.reaction >= Reaction.HOLD and (
                    held.source is rule.source or self._can_cause(rule, other)
                ):
                    return Reaction.NONE
        return rule.reaction

    def _can_cause(self, rule: FaultRule, other: int) -> bool:
        """Return whether this rule can be the cause of another fault, found shortly before.

        A rule that is itself a consequence of the other one is not asked: it has no reaction.
        """
        lately = self._cycle - self._since_cycle[other] <= CAUSE_CYCLES
        return lately and FaultSource.PROCESS not in {rule.source, self._rules[other].source}

    def _end(self, index: int) -> None:
        """End a present fault; without a latch it is over."""
        self.present &= ~(1 << index)
        if not self.latched >> index & 1:
            self._axes[index] = 0
            self.news.append(News(self._rules[index], self._last[index], False))

    def _drop(self, index: int) -> None:
        self.latched &= ~(1 << index)
        self._axes[index] = 0
        self._dropped.append(News(self._rules[index], self._last[index], False))

    def _select(self, bits: int, latch: Latch) -> int:
        """Return the faults of a bit mask that stop the stage and have at least this latch."""
        selected = 0
        for index in _positions(bits):
            rule = self._rules[index]
            if rule.reaction >= Reaction.HOLD and rule.latch >= latch:
                selected |= 1 << index
        return selected

    def _describe_worst(self, bits: int) -> str:
        """Return the most severe fault of a bit mask and its remedy; empty if the mask is empty."""
        if not bits:
            return ""
        index = max(_positions(bits), key=lambda place: self._rules[place].reaction)
        rule = self._rules[index]
        if self.present >> index & 1:
            return f"{rule.id} is present: {rule.name}; {rule.remedy}"
        reset = "`piezod reset --engineer`" if rule.latch is Latch.ENGINEER else "`piezod reset`"
        return (
            f"{rule.id} was found: {rule.name}; {rule.remedy}; "
            f"{reset} ends it once it has been gone for a second"
        )


def _source(detection: Detection) -> FaultSource:
    return FAULTS[INDEX[detection.fault]].source


def _positions(bits: int) -> Iterator[int]:
    """Yield the positions of the bits that are set."""
    while bits:
        lowest = bits & -bits
        yield lowest.bit_length() - 1
        bits ^= lowest
