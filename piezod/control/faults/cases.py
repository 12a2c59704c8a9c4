"""What holds for a fault where it depends on more than its id: device, number, code."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.table import (
    FAULTS,
    INDEX,
    Escalation,
    FaultRule,
    Latch,
    Reaction,
    Source,
)
from piezod.devices.status import DeviceFlag
from piezod.units import NS_PER_S


class Case(StrEnum):
    """Which case of a fault was found."""

    USUAL = ""
    """The one in the table."""
    SINGLE = "single"
    """It has happened, but not often enough to be reacted to."""
    SENSOR = "of a sensor"
    """The device only measures: what the amplifier does is still known."""
    AMPLIFIER = "of an amplifier"
    """The device drives."""
    REQUEST = "wrong request"
    """The device refuses what it is asked for."""
    BUSY = "busy"
    """The device, or a gateway, has no time now, again and again."""


COUNTED_FLAGS: Final = {
    DeviceFlag.PARTIAL_WRITE: Fault.A2,
    DeviceFlag.GARBAGE: Fault.B3,
    DeviceFlag.BAD_CHECKSUM: Fault.B4,
    DeviceFlag.LATE_REPLY: Fault.B5,
    DeviceFlag.OUT_OF_ORDER: Fault.B6,
    DeviceFlag.SLOW_REPLY: Fault.B7,
    DeviceFlag.BUSY: Fault.B10,
    DeviceFlag.BUS_OVERLOADED: Fault.B11,
}
"""One of these is a fault when its bucket has tripped: five cycles in a row, or many for long."""
NOT_SENT: Final = Fault.B9
"""The fault of frames that could not be sent, some in a row."""
_NEVER_AT_ONCE: Final = (*COUNTED_FLAGS.values(), NOT_SENT)
"""Faults that a single event does not make."""
LOST: Final = (Fault.A2, Fault.B1, Fault.B2, Fault.B8, Fault.B9, Fault.B13, Fault.B14, Fault.B15)
"""Faults that make an amplifier unreachable; of a sensor they are none the amplifier minds."""


def _single(rule: FaultRule) -> FaultRule:
    return rule._replace(reaction=Reaction.NONE, latch=Latch.L0, severity="info", escalation=None)


def _of_sensor(rule: FaultRule) -> FaultRule:
    worse = Escalation(0, NS_PER_S, Reaction.RAMP, Latch.L2)
    return rule._replace(reaction=Reaction.HOLD, latch=Latch.L1, escalation=worse)


_OTHER_CODES: Final = {
    (Fault.B10, Case.REQUEST): FaultRule(
        Fault.B10,
        "device knows no such register or command",
        Source.BUS,
        Reaction.HOLD,
        Latch.L3,
        "error",
        "check registers, channels and unit address in the configuration",
    ),
    (Fault.B10, Case.BUSY): FaultRule(
        Fault.B10,
        "device or gateway busy again and again",
        Source.BUS,
        Reaction.HOLD,
        Latch.L1,
        "error",
        "lower rate_hz; look for another program that asks the same device",
    ),
    (Fault.S10, Case.AMPLIFIER): FaultRule(
        Fault.S10,
        "amplifier is another device",
        Source.SENSOR,
        Reaction.BLIND,
        Latch.L3,
        "error",
        "connect the amplifier that the configuration names, or configure this one",
    ),
}

CASES: Final[Mapping[tuple[Fault, Case], FaultRule]] = {
    **{(fault, Case.SINGLE): _single(FAULTS[INDEX[fault]]) for fault in _NEVER_AT_ONCE},
    **{(fault, Case.SENSOR): _of_sensor(FAULTS[INDEX[fault]]) for fault in LOST},
    **_OTHER_CODES,
}
"""What holds instead of the table's rule."""


def rule_of(fault: Fault, case: Case) -> FaultRule:
    """Return what holds for a fault; may be called in the loop.

    Raises:
        KeyError: If there is no such case of it.
    """
    return FAULTS[INDEX[fault]] if case is Case.USUAL else CASES[fault, case]
