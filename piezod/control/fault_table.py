"""Every fault that a running daemon can find: what is done about it, and who may end it."""

from enum import IntEnum
from typing import Final, Literal, NamedTuple

Severity = Literal["info", "warning", "error"]


class Reaction(IntEnum):
    """What is done about a fault; the larger is the worse, and the worst wins."""

    NONE = 0
    """It is counted and shown."""
    WARN = 1
    """It is told; the stage goes on."""
    DEGRADE = 2
    """Adaptive and trimmed axes go on in feedforward, without a jump."""
    HOLD = 3
    """The last voltage is held; after a while, or at a second fault, RAMP."""
    RAMP = 4
    """The voltage goes to the safe one at the ramp's rate."""
    BLIND = 5
    """Nothing is sent until the amplifier answers again; then RAMP from what it reads back."""
    CUT = 6
    """The amplifier switches its output off; where it cannot, RAMP."""


class Latch(IntEnum):
    """What ends a fault."""

    L0 = 0
    """Nothing but its absence for a few cycles."""
    L1 = 1
    """`resume` or `reset`, once it is gone."""
    L2 = 2
    """`reset` by an operator, once it has been gone for a second."""
    L3 = 3
    """`reset` by an engineer, likewise."""


class Source(IntEnum):
    """Where a fault comes from; the smaller is the cause of the larger."""

    LOOP = 0
    BUS = 1
    AMPLIFIER = 2
    SENSOR = 3
    ADAPTATION = 4
    PROCESS = 5
    """Never the consequence of another."""


class Escalation(NamedTuple):
    """What becomes of a fault that stays.

    Attributes:
        cycles: From so many cycles after it appeared
        after_ns: and from so long after it appeared, it has
        reaction: this reaction and
        latch: this latch.
    """

    cycles: int
    after_ns: int
    reaction: Reaction
    latch: Latch


class FaultRule(NamedTuple):
    """One fault.

    Attributes:
        id: Short name, as in "S5".
        name: What it is, for people.
        source: Where it comes from.
        reaction: What is done when it appears.
        latch: What ends it.
        severity: Of its events.
        remedy: What a person does about it.
        escalation: What becomes of it when it stays; None: nothing more.
    """

    id: str
    name: str
    source: Source
    reaction: Reaction
    latch: Latch
    severity: Severity
    remedy: str
    escalation: Escalation | None = None


FAULTS: Final[tuple[FaultRule, ...]] = ()
"""All faults; the index of a fault is its bit in the masks of a record."""

INDEX: Final = {rule.id: index for index, rule in enumerate(FAULTS)}
"""Id: place in `FAULTS`."""
