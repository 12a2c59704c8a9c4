"""Which state follows which, for every state, event and combination of facts."""

from collections.abc import Iterator
from functools import cache
from itertools import product

import pytest

from piezod.config.states import State
from piezod.control.stage.states import Event, Facts, Transition, step

GOOD = Facts(
    output_known=True,
    sensor_valid=True,
    adapt_allowed=True,
    model_known=True,
    latched=False,
    shutting_down=False,
    estop_active=False,
)
NEVER_REFUSED = {
    Event.DISARM,
    Event.HOLD,
    Event.STOP,
    Event.ESTOP,
    Event.SHUTDOWN,
    Event.FAULT_HOLD,
    Event.FAULT_RAMP,
    Event.FAULT_BLIND,
    Event.FAULT_CUT,
}
INFLUENCE = [name for name in Facts._fields if name != "no_entry"]

# One row per event, one column per state; "." stays, "!" is refused, where all facts are good.
TABLE = """
                 BOOT     SAFE     READY IDENT RUN   HOLD  RAMP  BLIND    FAULT    ESTOP STOPPING
SELF_TEST_PASSED SAFE     .        .     .     .     .     .     .        .        .     .
SELF_TEST_FAILED FAULT    .        .     .     .     .     .     .        .        .     .
ARM              !        READY    .     !     .     !     !     !        !        !     !
DISARM           .        .        RAMP  RAMP  RAMP  RAMP  .     .        .        .     .
RUN              !        !        RUN   !     .     !     !     !        !        !     !
RUN_ADAPTIVE     !        !        RUN   !     .     !     !     !        !        !     !
IDENTIFY         !        !        IDENT !     !     !     !     !        !        !     !
IDENTIFY_DONE    .        .        .     READY .     .     .     .        .        .     .
HOLD             .        .        HOLD  HOLD  HOLD  .     .     .        .        .     .
RESUME           !        !        !     !     !     RUN   !     !        !        !     !
STOP             .        .        RAMP  RAMP  RAMP  RAMP  .     .        .        .     .
ESTOP            ESTOP    ESTOP    ESTOP ESTOP ESTOP ESTOP ESTOP .        ESTOP    .     .
ESTOP_RELEASED   .        .        .     .     .     .     .     .        .        FAULT .
RESET            !        .        .     .     .     !     !     !        SAFE     !     !
SHUTDOWN         STOPPING STOPPING RAMP  RAMP  RAMP  RAMP  .     STOPPING STOPPING RAMP  .
FAULT_HOLD       .        .        HOLD  HOLD  HOLD  RAMP  .     .        .        .     .
FAULT_RAMP       .        .        RAMP  RAMP  RAMP  RAMP  .     .        .        .     .
FAULT_BLIND      BLIND    BLIND    BLIND BLIND BLIND BLIND BLIND .        .        BLIND .
FAULT_CUT        FAULT    FAULT    FAULT FAULT FAULT FAULT FAULT FAULT    .        .     .
HOLD_EXPIRED     .        .        .     .     .     RAMP  .     .        .        .     .
AT_SAFE          .        .        .     .     .     .     SAFE  .        .        .     .
RAMP_TIMEOUT     .        .        .     .     .     .     FAULT .        .        FAULT .
LINK_BACK        .        .        .     .     .     .     .     RAMP     .        .     .
OUTPUT_UNKNOWN   .        .        .     .     .     .     .     FAULT    .        .     .
"""


def cases() -> Iterator[tuple[State, Event, str]]:
    """Go through the table: state, event, what is to become of it."""
    head, *rows = (line.split() for line in TABLE.strip().splitlines())
    for event, *entries in rows:
        for state, entry in zip(head, entries, strict=True):
            yield State(state), Event[event], entry


def all_facts() -> Iterator[Facts]:
    """Go through every combination of facts."""
    for values in product((False, True), repeat=len(INFLUENCE)):
        for no_entry in ("", "the disk is full"):
            yield GOOD._replace(no_entry=no_entry, **dict(zip(INFLUENCE, values, strict=True)))


@cache
def outcomes() -> frozenset[tuple[State, Event, Transition]]:
    """Return what can become of each state and event, over all combinations of facts."""
    return frozenset(
        (state, event, step(state, event, facts))
        for facts in all_facts()
        for state in State
        for event in Event
    )


def following(state: State, event: Event, facts: Facts) -> State:
    """Return the state that follows."""
    return step(state, event, facts).state


def test_the_table_names_every_state_and_event_once() -> None:
    """Nothing is left out."""
    named = [(state, event) for state, event, _ in cases()]

    assert sorted(named, key=str) == sorted(product(State, Event), key=str)


@pytest.mark.parametrize(("state", "event", "entry"), list(cases()))
def test_where_all_is_well_the_table_holds(state: State, event: Event, entry: str) -> None:
    """Each state and event leads where the table says."""
    after, refusal = step(state, event, GOOD)

    assert after == (state if entry in {".", "!"} else State(entry))
    assert bool(refusal) == (entry == "!")


def test_every_combination_has_an_answer_and_who_is_refused_stays() -> None:
    """It is total; a refusal tells the state, and changes nothing."""
    for state, _, (after, refusal) in outcomes():
        assert after in State
        if refusal:
            assert after is state
            assert refusal.startswith("cannot ")
            assert f" in {state}: " in refusal


def test_what_leads_down_is_never_refused() -> None:
    """Whatever the facts."""
    refused = {event for _, event, outcome in outcomes() if outcome.refusal}

    assert not refused & NEVER_REFUSED


def test_run_and_ident_begin_from_ready_alone() -> None:
    """RUN goes on from HOLD by `resume`, too; there is no other edge into them."""
    edges = {(state, event, after) for state, event, (after, _) in outcomes() if state != after}

    assert {edge for edge in edges if edge[2] in {State.RUN, State.IDENT}} == {
        (State.READY, Event.RUN, State.RUN),
        (State.READY, Event.RUN_ADAPTIVE, State.RUN),
        (State.READY, Event.IDENTIFY, State.IDENT),
        (State.HOLD, Event.RESUME, State.RUN),
    }
    assert {edge for edge in edges if edge[2] is State.READY} == {
        (State.SAFE, Event.ARM, State.READY),
        (State.IDENT, Event.IDENTIFY_DONE, State.READY),
        (State.HOLD, Event.RESUME, State.READY),
    }


def test_nothing_begins_with_a_latched_fault_an_estop_or_on_the_way_out() -> None:
    """Arming needs all of it to be well, and a known voltage."""
    for facts in all_facts():
        armed = following(State.SAFE, Event.ARM, facts) is State.READY
        well = facts.output_known and not (
            facts.latched or facts.estop_active or facts.shutting_down or facts.no_entry
        )

        assert armed == well


def test_adapting_needs_sensor_model_and_leave() -> None:
    """From READY as within RUN; the other modes need none of them."""
    for facts in all_facts():
        fit = facts.sensor_valid and facts.adapt_allowed and facts.model_known
        may_begin = not (facts.no_entry or facts.shutting_down)

        assert (not step(State.RUN, Event.RUN_ADAPTIVE, facts).refusal) == fit
        assert (not step(State.READY, Event.RUN_ADAPTIVE, facts).refusal) == (fit and may_begin)
        assert (not step(State.READY, Event.RUN, facts).refusal) == may_begin
        assert not step(State.RUN, Event.RUN, facts).refusal


def test_resume_goes_back_to_where_it_was_held() -> None:
    """To RUN or to READY; not while the fault lasts or is latched."""
    ready = GOOD._replace(was_running=False)

    assert following(State.HOLD, Event.RESUME, ready) is State.READY
    assert following(State.HOLD, Event.RESUME, GOOD._replace(latched=True)) is State.HOLD


def test_the_latch_decides_where_a_ramp_ends() -> None:
    """SAFE, FAULT with something latched, out of the daemon on the way out."""
    latched = GOOD._replace(latched=True)

    assert following(State.RAMP, Event.AT_SAFE, GOOD) is State.SAFE
    assert following(State.RAMP, Event.AT_SAFE, latched) is State.FAULT
    for facts in (GOOD, latched):
        leaving = facts._replace(shutting_down=True)
        assert following(State.RAMP, Event.AT_SAFE, leaving) is State.STOPPING


def test_a_latched_fault_is_never_safe() -> None:
    """What happens in SAFE, BOOT or RAMP with something latched leads to FAULT."""
    for state in (State.SAFE, State.BOOT, State.RAMP):
        for event in Event:
            after, refusal = step(state, event, GOOD._replace(latched=True))
            if not refusal and event is not Event.RESET:
                assert after is not State.SAFE


@pytest.mark.fault("P1")
@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("then", [Event.AT_SAFE, Event.RAMP_TIMEOUT])
def test_a_shutdown_ends_in_stopping_from_every_state(state: State, then: Event) -> None:
    """At once, or with the end of the ramp, though an emergency stop comes between."""
    leaving = GOOD._replace(shutting_down=True, latched=True, estop_active=True)
    after = following(state, Event.SHUTDOWN, leaving)

    assert following(after, then, leaving) is State.STOPPING
    stopped = following(after, Event.ESTOP, leaving)
    assert following(stopped, then, leaving) is State.STOPPING


@pytest.mark.parametrize("event", [Event.FAULT_BLIND, Event.FAULT_CUT])
def test_on_the_way_out_an_amplifier_that_is_gone_ends_it(event: Event) -> None:
    """Nobody waits for a voltage that cannot be reached."""
    assert following(State.RAMP, event, GOOD._replace(shutting_down=True)) is State.STOPPING


@pytest.mark.fault("E1")
def test_an_emergency_stop_ends_in_fault_once_it_is_released() -> None:
    """Not before, and the safe voltage alone does not end it."""
    pressed = GOOD._replace(estop_active=True, latched=True)

    assert following(State.ESTOP, Event.AT_SAFE, pressed) is State.ESTOP
    assert following(State.ESTOP, Event.ESTOP_RELEASED, pressed) is State.ESTOP
    assert following(State.ESTOP, Event.ESTOP_RELEASED, GOOD) is State.FAULT


@pytest.mark.fault("E1")
def test_an_emergency_stop_waits_for_an_amplifier_that_is_gone() -> None:
    """It begins, or goes on, from the voltage that is read back: never from one before."""
    pressed = GOOD._replace(estop_active=True, latched=True)

    assert following(State.ESTOP, Event.FAULT_BLIND, pressed) is State.BLIND
    assert following(State.BLIND, Event.ESTOP, pressed) is State.BLIND
    assert following(State.BLIND, Event.LINK_BACK, pressed) is State.ESTOP


def test_a_reset_needs_every_fault_to_be_dropped() -> None:
    """It leads to SAFE, never further."""
    assert following(State.FAULT, Event.RESET, GOOD._replace(latched=True)) is State.FAULT
    assert following(State.FAULT, Event.RESET, GOOD._replace(estop_active=True)) is State.FAULT
    assert following(State.FAULT, Event.RESET, GOOD) is State.SAFE


def test_an_amplifier_that_is_back_is_ramped_or_tested() -> None:
    """From what it reads back; the self-test comes first where it has not been; else it waits."""
    untested = GOOD._replace(self_tested=False)
    unknown = GOOD._replace(output_known=False)

    assert following(State.BLIND, Event.LINK_BACK, GOOD) is State.RAMP
    assert following(State.BLIND, Event.LINK_BACK, untested) is State.BOOT
    assert following(State.BLIND, Event.LINK_BACK, unknown) is State.BLIND


def test_an_amplifier_whose_voltage_nobody_knows_is_not_ramped() -> None:
    """It waits for a reset; nor is one ramped that nobody has driven."""
    unknown = GOOD._replace(output_known=False)
    idle = GOOD._replace(was_driven=False)

    assert following(State.BLIND, Event.OUTPUT_UNKNOWN, unknown) is State.FAULT
    assert following(State.BLIND, Event.LINK_BACK, idle) is State.SAFE
    assert following(State.BLIND, Event.LINK_BACK, idle._replace(latched=True)) is State.FAULT
    untested = unknown._replace(self_tested=False)
    assert following(State.BLIND, Event.OUTPUT_UNKNOWN, untested) is State.BOOT


@pytest.mark.parametrize("state", [state for state in State if state is not State.STOPPING])
def test_every_state_but_the_last_can_reach_safe(state: State) -> None:
    """There is no dead end; STOPPING ends the process."""
    reached, fresh = {state}, {state}
    while fresh:
        fresh = {following(s, event, GOOD) for s in fresh for event in Event} - reached
        reached |= fresh

    assert State.SAFE in reached
    assert State.STOPPING in reached


def test_a_refusal_says_what_would_help() -> None:
    """For people, with the verb to use."""
    refusal = step(State.SAFE, Event.RUN, GOOD).refusal
    no_entry = step(State.SAFE, Event.ARM, GOOD._replace(no_entry="the disk is full")).refusal

    assert refusal == "cannot move in SAFE: `piezod arm` first"
    assert no_entry == "cannot arm in SAFE: the disk is full"
