"""Which state follows which: pure, total, and never up by itself."""

from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import Final, NamedTuple

from piezod.config.states import State


class Event(Enum):
    """What may happen to a stage: asked for by somebody, or found by the daemon."""

    SELF_TEST_PASSED = auto()
    SELF_TEST_FAILED = auto()
    ARM = auto()
    DISARM = auto()
    RUN = auto()
    """Follow a command in a mode that does without the sensor."""
    RUN_ADAPTIVE = auto()
    """Follow a command in a mode that needs the sensor: adaptive, trimmed."""
    IDENTIFY = auto()
    """Drive a voltage waveform, to identify or to condition."""
    IDENTIFY_DONE = auto()
    HOLD = auto()
    RESUME = auto()
    STOP = auto()
    ESTOP = auto()
    ESTOP_RELEASED = auto()
    """To be told once the safe voltage is reached: FAULT writes nothing."""
    RESET = auto()
    """Told after the register has dropped what it may: `Facts.latched` is what is left."""
    SHUTDOWN = auto()
    """From here on `Facts.shutting_down`."""
    FAULT_HOLD = auto()
    FAULT_RAMP = auto()
    FAULT_BLIND = auto()
    FAULT_CUT = auto()
    """The output is off; where the amplifier cannot do that, tell FAULT_RAMP instead."""
    HOLD_EXPIRED = auto()
    AT_SAFE = auto()
    RAMP_TIMEOUT = auto()
    LINK_BACK = auto()
    OUTPUT_UNKNOWN = auto()
    """The amplifier answers again, and nobody can tell what is in force."""


class Facts(NamedTuple):
    """What decides about an edge besides state and event.

    Attributes:
        output_known: Whether the voltage in force is known on every axis.
        sensor_valid: Whether the samples of every axis concerned may be used.
        adapt_allowed: Whether no fault speaks against adapting.
        model_known: Whether the hysteresis' memory is known.
        latched: Whether a fault is latched that only `reset` ends (L2 or L3, HOLD or worse).
        shutting_down: Whether the daemon is on its way out.
        estop_active: Whether the emergency stop is still pressed.
        no_entry: Why nothing may be started now, for people; empty where it may.
        was_running: Whether HOLD came from RUN: `resume` leads back there, else to READY.
        self_tested: Whether the self-test has been passed since the process started.
        was_driven: Whether voltages were written when BLIND came.
    """

    output_known: bool
    sensor_valid: bool
    adapt_allowed: bool
    model_known: bool
    latched: bool
    shutting_down: bool
    estop_active: bool
    no_entry: str = ""
    was_running: bool = True
    self_tested: bool = True
    was_driven: bool = True


class Transition(NamedTuple):
    """What becomes of an event.

    Attributes:
        state: The state from now on; the one before where the event is refused or changes nothing.
        refusal: Why a request is refused and what would help; empty where it is carried out.
    """

    state: State
    refusal: str = ""


_BOOT, _SAFE, _READY, _RUN, _IDENT = State.BOOT, State.SAFE, State.READY, State.RUN, State.IDENT
_HOLD, _RAMP, _BLIND, _FAULT = State.HOLD, State.RAMP, State.BLIND, State.FAULT
_ESTOP, _STOPPING = State.ESTOP, State.STOPPING
_MOVABLE: Final = (_READY, _RUN, _IDENT)
_HELD: Final = (*_MOVABLE, _HOLD)
_LIVE: Final = (_BOOT, _SAFE, *_HELD, _RAMP)

_EDGES: Final[Mapping[Event, Mapping[State, State]]] = {
    Event.SELF_TEST_PASSED: {_BOOT: _SAFE},
    Event.SELF_TEST_FAILED: {_BOOT: _FAULT},
    Event.DISARM: dict.fromkeys(_HELD, _RAMP),
    Event.IDENTIFY_DONE: {_IDENT: _READY},
    Event.HOLD: dict.fromkeys(_MOVABLE, _HOLD),
    Event.STOP: dict.fromkeys(_HELD, _RAMP),
    # In BLIND nothing can be sent; the emergency stop comes with the link, see LINK_BACK.
    Event.ESTOP: dict.fromkeys((*_LIVE, _FAULT), _ESTOP),
    Event.ESTOP_RELEASED: {_ESTOP: _FAULT},
    Event.SHUTDOWN: {
        **dict.fromkeys((*_HELD, _ESTOP), _RAMP),
        **dict.fromkeys((_BOOT, _SAFE, _BLIND, _FAULT), _STOPPING),
    },
    Event.FAULT_HOLD: {**dict.fromkeys(_MOVABLE, _HOLD), _HOLD: _RAMP},
    Event.FAULT_RAMP: dict.fromkeys(_HELD, _RAMP),
    Event.FAULT_BLIND: dict.fromkeys((*_LIVE, _ESTOP), _BLIND),
    Event.FAULT_CUT: dict.fromkeys((*_LIVE, _BLIND), _FAULT),
    Event.HOLD_EXPIRED: {_HOLD: _RAMP},
    Event.AT_SAFE: {_RAMP: _SAFE},
    Event.RAMP_TIMEOUT: dict.fromkeys((_RAMP, _ESTOP), _FAULT),
    Event.LINK_BACK: {_BLIND: _RAMP},
    Event.OUTPUT_UNKNOWN: {_BLIND: _FAULT},
}
"""Edges that nobody is refused: down, or found by the daemon. From any other state: none."""

_HELP: Final[Mapping[State, str]] = {
    _BOOT: "wait for the end of the self-test",
    _SAFE: "`piezod arm` first",
    _READY: "`piezod goto`, `piezod wave` or `piezod mode` start a movement",
    _RUN: "`piezod stop` and `piezod arm` first",
    _IDENT: "wait for the end of the waveform, or `piezod stop`",
    _HOLD: "`piezod resume` or `piezod stop` first",
    _RAMP: "wait until the safe voltage is reached",
    _BLIND: "the amplifier does not answer: check its power and cable",
    _FAULT: "remove the cause that `piezod faults` shows, then `piezod reset`",
    _ESTOP: "release the emergency stop first, then `piezod reset`",
    _STOPPING: "the daemon is on its way out: start it again",
}


def step(state: State, event: Event, facts: Facts) -> Transition:
    """Return what becomes of an event; total and pure; may be called in the loop.

    What leads down is never refused. RUN and IDENT begin from READY only, RUN also goes on from
    HOLD; what a fault has stopped comes back through SAFE.
    """
    request = _REQUESTS.get(event)
    if request is not None:
        return request(state, facts)
    return Transition(_settled(_following(state, event, facts), event, facts))


def _following(state: State, event: Event, facts: Facts) -> State:
    if state is _BLIND and event in {Event.LINK_BACK, Event.OUTPUT_UNKNOWN}:
        return _reached(event, facts)
    if event is Event.ESTOP_RELEASED and facts.estop_active:
        return state
    if event is Event.ESTOP and state in {_BOOT, _SAFE, _FAULT} and not facts.output_known:
        return _BLIND  # no way to the safe voltage begins at a voltage that nobody knows
    return _EDGES[event].get(state, state)


def _reached(event: Event, facts: Facts) -> State:
    """Return where BLIND leads once the amplifier answers again."""
    known = event is Event.LINK_BACK
    if known and not facts.output_known:
        return _BLIND
    if known and facts.estop_active:
        return _ESTOP
    if not facts.self_tested:
        return _BOOT
    if not facts.was_driven:
        return _SAFE  # what nobody has driven is only looked at
    return _RAMP if known else _FAULT


def _settled(state: State, event: Event, facts: Facts) -> State:
    """Return where a state leads at once: out of the daemon, or to FAULT with what is latched."""
    if facts.shutting_down:
        arrived = state is _ESTOP and event is Event.AT_SAFE
        return _STOPPING if arrived or state in {_SAFE, _BLIND, _FAULT} else state
    return _FAULT if state is _SAFE and facts.latched else state


def _arm(state: State, facts: Facts) -> Transition:
    if state in {_READY, _RUN}:
        return Transition(state)
    if state is not _SAFE:
        return _refused(state, "arm")
    if facts.estop_active:
        return _refused(state, "arm", "release the emergency stop first")
    if facts.latched:
        return _refused(state, "arm", _HELP[_FAULT])
    if not facts.output_known:
        help_text = "check the amplifier; one that does not read back needs `--confirm-output`"
        return _refused(state, "arm", f"the voltage in force is not known: {help_text}")
    return _entered(_READY, state, facts, "arm")


def _run(state: State, facts: Facts) -> Transition:
    if state is _RUN:
        return Transition(_RUN)
    return _entered(_RUN, state, facts, "move")


def _run_adaptive(state: State, facts: Facts) -> Transition:
    if state in {_READY, _RUN}:
        if not facts.sensor_valid:
            return _refused(state, "adapt", "the sensor gives no valid sample: see `piezod faults`")
        if not facts.adapt_allowed:
            return _refused(state, "adapt", "a fault forbids it: see `piezod faults`")
        if not facts.model_known:
            return _refused(state, "adapt", "the hysteresis is not known: `piezod condition` first")
    return _run(state, facts)


def _identify(state: State, facts: Facts) -> Transition:
    return _entered(_IDENT, state, facts, "drive a waveform of voltages")


def _resume(state: State, facts: Facts) -> Transition:
    if state is not _HOLD:
        help_text = "nothing is held" if state in {_SAFE, *_MOVABLE} else _HELP[state]
        return _refused(state, "resume", help_text)
    if facts.latched:
        return _refused(state, "resume", "the fault is not over: see `piezod faults`")
    return Transition(_RUN if facts.was_running else _READY)


def _reset(state: State, facts: Facts) -> Transition:
    if state in {_SAFE, *_MOVABLE}:
        return Transition(state)  # only what forbids to adapt can be latched here
    if state is not _FAULT:
        return _refused(state, "reset")
    if facts.estop_active:
        return _refused(state, "reset", "release the emergency stop first")
    if facts.latched:
        return _refused(state, "reset", "a fault is not over: see `piezod faults`")
    return Transition(_SAFE)


def _entered(target: State, state: State, facts: Facts, what: str) -> Transition:
    """Go up to a state that begins something, from the only one that leads there."""
    if state is not (_SAFE if target is _READY else _READY):
        return _refused(state, what)
    if facts.shutting_down:
        return _refused(state, what, _HELP[_STOPPING])
    if facts.no_entry:
        return _refused(state, what, facts.no_entry)
    return Transition(target)


def _refused(state: State, what: str, help_text: str = "") -> Transition:
    return Transition(state, f"cannot {what} in {state}: {help_text or _HELP[state]}")


_REQUESTS: Final[Mapping[Event, Callable[[State, Facts], Transition]]] = {
    Event.ARM: _arm,
    Event.RUN: _run,
    Event.RUN_ADAPTIVE: _run_adaptive,
    Event.IDENTIFY: _identify,
    Event.RESUME: _resume,
    Event.RESET: _reset,
}
"""What leads up, and may be refused."""
