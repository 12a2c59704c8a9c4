"""What a request towards safety has come to, from the state after it."""

from collections.abc import Mapping
from typing import Final

from piezod.config.states import State

_REACHED: Final[Mapping[str, State]] = {
    "disarm": State.RAMP,
    "stop": State.RAMP,
    "hold": State.HOLD,
    "estop": State.ESTOP,
}
"""State in which each of these requests has done what its name says."""
_IN_PLACE: Final[Mapping[State, str]] = {
    State.BOOT: "the self-test is not over, nothing is driven",
    State.SAFE: "nothing is driven",
    State.READY: "the voltage is held",
    State.RUN: "the movement goes on",
    State.IDENT: "the waveform goes on",
    State.HOLD: "the voltage is held",
    State.RAMP: "the ramp to the safe voltage goes on",
    State.FAULT: "nothing is written; `piezod faults` shows the cause",
    State.ESTOP: "the emergency stop goes on",
    State.STOPPING: "the daemon is ending",
}
_LATER: Final = (
    "nothing can be sent to the amplifier; the request will be carried out when it answers; "
    "`piezod faults` shows the cause"
)


def outcome(verb: str, done: str, state: str) -> str:
    """Return what to print for an accepted request.

    Args:
        verb: The words of the verb.
        done: What to print if it has done what its name says.
        state: State of the stage after the request; empty if the daemon does not report it.
    """
    reached = _REACHED.get(verb)
    if reached is None or state in ("", reached):
        return done
    if state == State.BLIND:
        return f"not yet, the stage is in {state}: {_LATER}"
    return f"no change, the stage is in {state}: {_IN_PLACE[State(state)]}"
