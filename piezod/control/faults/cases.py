"""Cases of a fault: rules that depend on the device, on a count or on an error code."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.table import (
    FAULTS,
    INDEX,
    Escalation,
    FaultRule,
    FaultSource,
    Latch,
    Reaction,
)
from piezod.devices.status import DeviceFlag
from piezod.units import NS_PER_S


class Case(StrEnum):
    """Case of a fault."""

    USUAL = ""
    """The rule in the table holds."""
    SINGLE = "single"
    """It has happened, but not often enough for a reaction."""
    SENSOR = "of a sensor"
    """The device only measures; the amplifier can still be reached."""
    AMPLIFIER = "of an amplifier"
    """The device is an amplifier."""
    REQUEST = "wrong request"
    """The device rejects a request as wrong."""
    BUSY = "busy"
    """The device, or a gateway, is busy repeatedly."""
    STRICT = "with strict_rt"
    """The configuration requests a punctual loop."""


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
"""Flags that are a fault when their bucket has tripped: five cycles in a row, or many for long."""
NOT_SENT: Final = Fault.B9
"""Fault of several frames in a row that could not be sent."""
_COUNTED_FAULTS: Final = (*COUNTED_FLAGS.values(), NOT_SENT)
"""Faults that a single event does not raise."""
UNREACHABLE: Final = (
    Fault.A2,
    Fault.B1,
    Fault.B2,
    Fault.B8,
    Fault.B9,
    Fault.B13,
    Fault.B14,
    Fault.B15,
)
"""Faults that make an amplifier unreachable. If only a sensor has them, the amplifier still
works."""

DOUBTING: Final = (
    Fault.S1,
    Fault.S3,
    Fault.S7,
    Fault.S8,
    Fault.S9,
    Fault.S10,
    Fault.S11,
    Fault.A3,
    Fault.A7,
    Fault.A12,
    Fault.B6,
    Fault.B12,
)
"""Faults that say that pairs of sample and voltage may have been wrong for some time before: of a
sensor that lies, or of an amplifier that does not output what it takes. A sample that is absent,
late or only noisy is no lie; it was left out when it came."""


def _single_rule(rule: FaultRule) -> FaultRule:
    """Return the rule for a single event: it is shown, without a reaction."""
    quiet = rule._replace(reaction=Reaction.NONE, latch=Latch.ITSELF, escalation=None)
    return quiet._replace(severity="info")


def _sensor_rule(rule: FaultRule) -> FaultRule:
    """Return the rule for a device that only measures: hold, then ramp from the known voltage."""
    escalation = Escalation(0, NS_PER_S, Reaction.RAMP, Latch.RESET)
    return rule._replace(reaction=Reaction.HOLD, latch=Latch.RESUME, escalation=escalation)


def _strict_rule(fault: Fault, reaction: Reaction) -> FaultRule:
    """Return the rule with `loop.strict_rt`: a person ends the fault."""
    return FAULTS[INDEX[fault]]._replace(reaction=reaction, latch=Latch.RESUME)


_OTHER_CASES: Final = {
    (Fault.B10, Case.REQUEST): FaultRule(
        Fault.B10,
        "device has no such register or command",
        FaultSource.BUS,
        Reaction.HOLD,
        Latch.ENGINEER,
        "error",
        "check registers, channels and unit address in the configuration",
    ),
    (Fault.B10, Case.BUSY): FaultRule(
        Fault.B10,
        "device or gateway repeatedly busy",
        FaultSource.BUS,
        Reaction.HOLD,
        Latch.RESUME,
        "error",
        "lower rate_hz; look for another program that uses the same device",
    ),
    (Fault.S10, Case.AMPLIFIER): FaultRule(
        Fault.S10,
        "amplifier is not the configured device",
        FaultSource.SENSOR,
        Reaction.BLIND,
        Latch.ENGINEER,
        "error",
        "connect the amplifier that the configuration names, or configure this one",
    ),
}

CASES: Final[Mapping[tuple[Fault, Case], FaultRule]] = {
    **{(fault, Case.SINGLE): _single_rule(FAULTS[INDEX[fault]]) for fault in _COUNTED_FAULTS},
    **{(fault, Case.SENSOR): _sensor_rule(FAULTS[INDEX[fault]]) for fault in UNREACHABLE},
    (Fault.L2, Case.STRICT): _strict_rule(Fault.L2, Reaction.HOLD)._replace(
        name="cycles repeatedly late"
    ),
    (Fault.L5, Case.STRICT): _strict_rule(Fault.L5, Reaction.RAMP),
    (Fault.L7, Case.STRICT): _strict_rule(Fault.L7, Reaction.DEGRADE),
    **_OTHER_CASES,
}
"""Rules that replace the rule in the table."""


def rule_of(fault: Fault, case: Case) -> FaultRule:
    """Return the rule that holds for a case of a fault. Real-time safe.

    Raises:
        KeyError: If the fault has no such case.
    """
    return FAULTS[INDEX[fault]] if case is Case.USUAL else CASES[fault, case]
