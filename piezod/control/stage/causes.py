"""What has brought a stage into its state, for people: a fault, a request, or a state before it."""

from collections.abc import Sequence
from typing import Final

from piezod.control.faults.detection import News
from piezod.control.faults.table import Reaction
from piezod.control.stage.states import Event
from piezod.units import NS_PER_S

_FAULTS: Final = frozenset(
    {Event.FAULT_HOLD, Event.FAULT_RAMP, Event.FAULT_BLIND, Event.FAULT_CUT, Event.SELF_TEST_FAILED}
)
_REQUESTS: Final = {
    Event.DISARM: "`disarm`",
    Event.STOP: "`stop`",
    Event.HOLD: "`hold` or the end of a stream",
    Event.ESTOP: "the emergency stop",
    Event.SHUTDOWN: "`shutdown`",
}
_CONSEQUENCES: Final = frozenset(
    {
        Event.AT_SAFE,
        Event.HOLD_EXPIRED,
        Event.LINK_BACK,
        Event.OUTPUT_UNKNOWN,
        Event.RAMP_TIMEOUT,
        Event.ESTOP_RELEASED,
    }
)
"""Events that follow from the state before: its cause is theirs."""


def cause_of(event: Event, news: Sequence[News], before: str) -> str:
    """Return the cause of the state that an event leads to; empty if it needs no explanation.

    Args:
        event: The event.
        news: Changes of the faults in this cycle.
        before: Cause of the state before.
    """
    if event in _CONSEQUENCES:
        return before
    if event in _FAULTS:
        ids = [
            each.rule.id for each in news if each.appeared and each.rule.reaction > Reaction.DEGRADE
        ]
        return ", ".join(dict.fromkeys(ids)) or before
    return _REQUESTS.get(event, "")


def explained(refusal: str, state: str, cause: str, duration_ns: int) -> str:
    """Return a refusal with the time in the present state, and what has led there."""
    if not refusal or not cause:
        return refusal
    return f"{refusal} (in {state} for {_duration(duration_ns)} because of {cause})"


def _duration(duration_ns: int) -> str:
    seconds = duration_ns // NS_PER_S
    if seconds < 100:
        return f"{seconds} s"
    return f"{seconds // 60} min" if seconds < 6000 else f"{seconds // 3600} h"
