"""The state machine of a stage: pure and total. It never goes to a driven state by itself."""

from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import Final, NamedTuple

from piezod.config.states import State
from piezod.control.in_force import OUTPUT_WAIT_S


class Event(Enum):
    """An event of the state machine: a request, or a finding of the daemon."""

    SELF_TEST_PASSED = auto()
    SELF_TEST_FAILED = auto()
    FOUND_DRIVEN = auto()
    """Found the voltage of a daemon that did not end in order."""
    ARM = auto()
    DISARM = auto()
    RUN = auto()
    """Follow a command in a mode that does not need the sensor."""
    RUN_ADAPTIVE = auto()
    """Follow a command in a mode that needs the sensor: adaptive, trimmed, closed."""
    IDENTIFY = auto()
    """Drive a voltage waveform, to identify or to condition."""
    IDENTIFY_DONE = auto()
    HOLD = auto()
    RESUME = auto()
    STOP = auto()
    ESTOP = auto()
    ESTOP_RELEASED = auto()
    """To be raised at the safe voltage only, because FAULT writes nothing."""
    RESET = auto()
    """Raised after the register has dropped faults: `Facts.latched` holds the remaining ones."""
    SHUTDOWN = auto()
    """`Facts.shutting_down` is True from this event on."""
    FAULT_HOLD = auto()
    FAULT_RAMP = auto()
    FAULT_BLIND = auto()
    FAULT_CUT = auto()
    """The output is off. If the amplifier cannot do that, FAULT_RAMP is raised instead."""
    HOLD_EXPIRED = auto()
    AT_SAFE = auto()
    RAMP_TIMEOUT = auto()
    LINK_BACK = auto()
    OUTPUT_UNKNOWN = auto()
    """The amplifier answers again, but the voltage in force is unknown."""


class HoldCause(Enum):
    """Cause of a HOLD. It decides what ends it."""

    FAULT = auto()
    """A person resumes; after a while the stage ramps to the safe voltage."""
    REQUEST = auto()
    """A person resumes or stops."""
    LATENESS = auto()
    """The stage resumes by itself when its cycles are punctual again."""


class Facts(NamedTuple):
    """Conditions of an edge besides state and event."""

    output_known: bool  #: Whether the voltage in force is known on every axis.
    sensor_valid: bool  #: Whether the samples of every axis may be used.
    adapt_allowed: bool  #: Whether no fault forbids adaptation.
    model_known: bool  #: Whether the hysteresis memory is known.
    latched: bool  #: Whether a fault is latched that only `reset` ends (L2 or L3, HOLD or worse).
    shutting_down: bool  #: Whether the daemon is ending.
    estop_active: bool  #: Whether the emergency stop is still pressed.
    #: Axes that another voltage than the safe one was written to last, without a read-back, for
    #: people; empty if there are none.
    last_write: str = ""
    no_entry: str = ""  #: Why nothing may be started now, for people; empty if nothing forbids it.
    #: Whether HOLD came from RUN. Then `resume` leads back to RUN, otherwise to READY.
    was_running: bool = True
    self_tested: bool = True  #: Whether the self-test has passed since the process started.
    was_driven: bool = True  #: Whether voltages were written before BLIND.


class Transition(NamedTuple):
    """Result of an event."""

    state: State  #: State from now on; the same state if the event is refused or changes nothing.
    refusal: str = ""  #: Why a request is refused, and what would help; empty if it is carried out.


_BOOT, _SAFE, _READY, _RUN, _IDENT = State.BOOT, State.SAFE, State.READY, State.RUN, State.IDENT
_HOLD, _RAMP, _BLIND, _FAULT = State.HOLD, State.RAMP, State.BLIND, State.FAULT
_ESTOP, _STOPPING = State.ESTOP, State.STOPPING
_ARMED: Final = (_READY, _RUN, _IDENT)
_ARMED_OR_HELD: Final = (*_ARMED, _HOLD)
_LIVE: Final = (_BOOT, _SAFE, *_ARMED_OR_HELD, _RAMP)

_EDGES: Final[Mapping[Event, Mapping[State, State]]] = {
    Event.SELF_TEST_PASSED: {_BOOT: _SAFE},
    Event.SELF_TEST_FAILED: {_BOOT: _FAULT},
    Event.FOUND_DRIVEN: {_BOOT: _RAMP},
    Event.DISARM: dict.fromkeys(_ARMED_OR_HELD, _RAMP),
    Event.IDENTIFY_DONE: {_IDENT: _READY},
    Event.STOP: dict.fromkeys(_ARMED_OR_HELD, _RAMP),
    # In BLIND nothing can be sent. The emergency stop follows when the link is back: see LINK_BACK.
    Event.ESTOP: dict.fromkeys((*_LIVE, _FAULT), _ESTOP),
    Event.ESTOP_RELEASED: {_ESTOP: _FAULT},
    Event.SHUTDOWN: {
        **dict.fromkeys((*_ARMED_OR_HELD, _ESTOP), _RAMP),
        **dict.fromkeys((_BOOT, _SAFE, _BLIND, _FAULT), _STOPPING),
    },
    Event.FAULT_HOLD: {**dict.fromkeys(_ARMED, _HOLD), _HOLD: _RAMP},
    Event.FAULT_RAMP: dict.fromkeys(_ARMED_OR_HELD, _RAMP),
    Event.FAULT_BLIND: dict.fromkeys((*_LIVE, _ESTOP), _BLIND),
    Event.FAULT_CUT: dict.fromkeys((*_LIVE, _BLIND), _FAULT),
    Event.HOLD_EXPIRED: {_HOLD: _RAMP},
    Event.AT_SAFE: {_RAMP: _SAFE},
    Event.RAMP_TIMEOUT: dict.fromkeys((_RAMP, _ESTOP), _FAULT),
    Event.LINK_BACK: {_BLIND: _RAMP},
    Event.OUTPUT_UNKNOWN: {_BLIND: _FAULT},
}
"""Edges that are never refused: they lead down, or the daemon raises them. Missing states stay."""

_END_ESTOP: Final = "the emergency stop was not carried out to its end: `piezod estop` does that"

_HELP: Final[Mapping[State, str]] = {
    _BOOT: "wait for the end of the self-test",
    _SAFE: "`piezod arm` first",
    _READY: "`piezod goto`, `piezod wave` or `piezod mode` start a movement",
    _RUN: "`piezod stop` and `piezod arm` first",
    _IDENT: "wait for the end of the waveform, or `piezod stop`",
    _HOLD: "`piezod resume` or `piezod stop` first",
    _RAMP: "wait until the safe voltage is reached",
    _BLIND: "nothing can be sent to the amplifier: `piezod faults` shows the cause",
    _FAULT: "remove the cause that `piezod faults` shows, then `piezod reset`",
    _ESTOP: "wait until the safe voltage is reached, which takes up to "
    f"{OUTPUT_WAIT_S:g} s more if the output does not follow, then `piezod reset`",
    _STOPPING: "the daemon is ending: start it again",
}


def step(state: State, event: Event, facts: Facts) -> Transition:
    """Return the result of an event. Total, pure and real-time safe.

    Events that lead down are never refused. RUN and IDENT start from READY only; RUN also resumes
    from HOLD. After a fault has stopped the stage, the way up leads through SAFE.
    """
    request = _REQUESTS.get(event)
    if request is not None:
        return request(state, facts)
    return Transition(_pass_through(_next_state(state, event, facts), event, facts))


def _next_state(state: State, event: Event, facts: Facts) -> State:
    """Return the state after an event that is never refused."""
    # Leaving BLIND depends on more facts than any other edge.
    if state is _BLIND and event in {Event.LINK_BACK, Event.OUTPUT_UNKNOWN}:
        return _after_blind(event, facts)
    if event is Event.ESTOP_RELEASED and facts.estop_active:
        return state
    if event is Event.ESTOP and state in {_BOOT, _SAFE, _FAULT} and not facts.output_known:
        return _BLIND  # a ramp cannot start at an unknown voltage
    return _EDGES[event].get(state, state)


def _after_blind(event: Event, facts: Facts) -> State:
    """Return the state after BLIND, when the amplifier answers again."""
    known = event is Event.LINK_BACK
    if known and not facts.output_known:
        return _BLIND
    if known and facts.estop_active:
        return _ESTOP
    if not facts.self_tested:
        return _BOOT
    if not facts.was_driven:
        return _SAFE  # an output that was not driven is only observed
    return _RAMP if known else _FAULT


def _pass_through(state: State, event: Event, facts: Facts) -> State:
    """Return the state behind a state that cannot last: at shutdown, or with a latched fault."""
    if facts.shutting_down:
        # At shutdown the safe voltage also ends an emergency stop, which could not be released
        # later.
        arrived = state is _ESTOP and event is Event.AT_SAFE
        return _STOPPING if arrived or state in {_SAFE, _BLIND, _FAULT} else state
    return _FAULT if state is _SAFE and facts.latched else state


def _arm(state: State, facts: Facts) -> Transition:
    # Arming an armed stage changes nothing and is no error.
    if state in {_READY, _RUN}:
        return Transition(state)
    if state is not _SAFE:
        return _refuse(state, "arm")
    if facts.estop_active:
        return _refuse(state, "arm", _END_ESTOP)
    if facts.latched:
        return _refuse(state, "arm", _HELP[_FAULT])
    if not facts.output_known:
        return _refuse(state, "arm", _unknown(facts))
    return _start(_READY, state, facts, "arm")


def _unknown(facts: Facts) -> str:
    """Return that the voltage in force is unknown, and what makes it known."""
    unknown = "the voltage in force is unknown"
    states = "`--confirm-output` states that the output is at the safe voltage"
    if not facts.last_write:
        return f"{unknown}: check the amplifier; without a read-back, {states}"
    return (
        f"{unknown} (last write: {facts.last_write}), and {states}: end the daemon; then `piezod "
        "safe CONFIG` ramps down from the last write, or, if you have seen that the output is at "
        "the safe voltage, `piezod safe CONFIG --confirm-output` starts there"
    )


def _run(state: State, facts: Facts) -> Transition:
    if state is _RUN:
        return Transition(_RUN)
    return _start(_RUN, state, facts, "move")


def _run_adaptive(state: State, facts: Facts) -> Transition:
    if state in {_READY, _RUN}:
        if not facts.sensor_valid:
            return _refuse(state, "adapt", "the sensor gives no valid sample: see `piezod faults`")
        if not facts.adapt_allowed:
            return _refuse(state, "adapt", "a fault forbids it: see `piezod faults`")
        if not facts.model_known:
            return _refuse(state, "adapt", "the hysteresis is unknown: `piezod condition` first")
    return _run(state, facts)


def _identify(state: State, facts: Facts) -> Transition:
    return _start(_IDENT, state, facts, "drive a voltage waveform")


def _hold(state: State, facts: Facts) -> Transition:  # noqa: ARG001 - as the other requests
    if state in _ARMED_OR_HELD:
        return Transition(_HOLD)
    held = "nothing is driven" if state in {_BOOT, _SAFE, _FAULT, _STOPPING} else _HELP[state]
    return _refuse(state, "hold", held)


def _resume(state: State, facts: Facts) -> Transition:
    if state is not _HOLD:
        remedy = "nothing is held" if state in {_SAFE, *_ARMED} else _HELP[state]
        return _refuse(state, "resume", remedy)
    if facts.latched:
        return _refuse(state, "resume", "the fault is not over: see `piezod faults`")
    return Transition(_RUN if facts.was_running else _READY)


def _reset(state: State, facts: Facts) -> Transition:
    if state in {_SAFE, *_ARMED}:
        return Transition(state)  # only faults that forbid adaptation can be latched here
    if state is not _FAULT:
        return _refuse(state, "reset")
    if facts.estop_active:
        return _refuse(state, "reset", _END_ESTOP)
    if facts.latched:
        return _refuse(state, "reset", "a fault is not over: see `piezod faults`")
    return Transition(_SAFE)


def _start(target: State, state: State, facts: Facts, action: str) -> Transition:
    """Go to READY, RUN or IDENT, from the only state that leads there."""
    if state is not (_SAFE if target is _READY else _READY):
        return _refuse(state, action)
    if facts.shutting_down:
        return _refuse(state, action, _HELP[_STOPPING])
    if facts.no_entry:
        return _refuse(state, action, facts.no_entry)
    return Transition(target)


def _refuse(state: State, action: str, remedy: str = "") -> Transition:
    return Transition(state, f"cannot {action} in {state}: {remedy or _HELP[state]}")


_REQUESTS: Final[Mapping[Event, Callable[[State, Facts], Transition]]] = {
    Event.ARM: _arm,
    Event.RUN: _run,
    Event.RUN_ADAPTIVE: _run_adaptive,
    Event.IDENTIFY: _identify,
    Event.HOLD: _hold,
    Event.RESUME: _resume,
    Event.RESET: _reset,
}
"""Events that may be refused: they lead up, or there is nothing to hold."""
