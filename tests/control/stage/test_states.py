"""Tests of the state machine, for every state, event and combination of facts."""

from collections.abc import Iterator
from itertools import combinations, product
from pathlib import Path

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
    Event.STOP,
    Event.ESTOP,
    Event.SHUTDOWN,
    Event.FAULT_HOLD,
    Event.FAULT_RAMP,
    Event.FAULT_BLIND,
    Event.FAULT_CUT,
}
Outcomes = frozenset[tuple[State, Event, Transition]]
TEXTS = {"no_entry": "the disk is full", "last_write": "axis x at 30 V instead of 0 V"}
INFLUENCE = [name for name in Facts._fields if name not in TEXTS]

# One row per event, one column per state: "." stays, "!" is refused, if all facts are good.
TABLE = """
                 BOOT     SAFE     READY IDENT RUN   HOLD  RAMP  BLIND    FAULT    ESTOP STOPPING
SELF_TEST_PASSED SAFE     .        .     .     .     .     .     .        .        .     .
SELF_TEST_FAILED FAULT    .        .     .     .     .     .     .        .        .     .
FOUND_DRIVEN     RAMP     .        .     .     .     .     .     .        .        .     .
ARM              !        READY    .     !     .     !     !     !        !        !     !
DISARM           .        .        RAMP  RAMP  RAMP  RAMP  .     .        .        .     .
RUN              !        !        RUN   !     .     !     !     !        !        !     !
RUN_ADAPTIVE     !        !        RUN   !     .     !     !     !        !        !     !
IDENTIFY         !        !        IDENT !     !     !     !     !        !        !     !
IDENTIFY_DONE    .        .        .     READY .     .     .     .        .        .     .
HOLD             !        !        HOLD  HOLD  HOLD  .     !     !        !        !     !
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
    """Yield the entries of the table: state, event, expected result."""
    head, *rows = (line.split() for line in TABLE.strip().splitlines())
    for event, *entries in rows:
        for state, entry in zip(head, entries, strict=True):
            yield State(state), Event[event], entry


def all_facts() -> Iterator[Facts]:
    """Yield every combination of facts."""
    for values in product((False, True), repeat=len(INFLUENCE)):
        facts = GOOD._asdict() | dict(zip(INFLUENCE, values, strict=True))
        for texts in product(*(("", text) for text in TEXTS.values())):
            yield Facts(**(facts | dict(zip(TEXTS, texts, strict=True))))


def rarely_bad_facts() -> Iterator[Facts]:
    """Yield the combinations with up to three facts that are not good."""
    for count in range(4):
        for names in combinations(Facts._fields, count):
            changed = {name: TEXTS.get(name, not getattr(GOOD, name)) for name in names}
            yield Facts(**(GOOD._asdict() | changed))


@pytest.fixture
def outcomes() -> Outcomes:
    """Return the results of each state and event.

    For each test anew, because `make mutants` runs for a change the tests that have called it.
    """
    return frozenset(
        (state, event, step(state, event, facts))
        for facts in rarely_bad_facts()
        for state in State
        for event in Event
    )


def next_state(state: State, event: Event, facts: Facts) -> State:
    """Return the next state."""
    return step(state, event, facts).state


def test_table_has_every_state_and_event_once() -> None:
    """The table is complete."""
    named = [(state, event) for state, event, _ in cases()]

    assert sorted(named, key=str) == sorted(product(State, Event), key=str)


@pytest.mark.parametrize(("state", "event", "entry"), list(cases()))
def test_states_follow_the_table_if_all_facts_are_good(
    state: State, event: Event, entry: str
) -> None:
    """Each state and event leads to the state in the table."""
    after, refusal = step(state, event, GOOD)

    assert after == (state if entry in {".", "!"} else State(entry))
    assert bool(refusal) == (entry == "!")


def test_every_combination_has_a_result_and_a_refusal_keeps_the_state(outcomes: Outcomes) -> None:
    """The function is total; a refusal names the state. No combination has a result of its own."""
    everything = {
        (state, event, step(state, event, facts))
        for facts in all_facts()
        for state in State
        for event in Event
    }

    assert everything == outcomes
    for state, _, (after, refusal) in everything:
        assert after in State
        if refusal:
            assert after is state
            assert refusal.startswith("cannot ")
            assert f" in {state}: " in refusal


def test_events_that_lead_down_are_never_refused(outcomes: Outcomes) -> None:
    """This holds for all facts."""
    refused = {event for _, event, outcome in outcomes if outcome.refusal}

    assert not refused & NEVER_REFUSED


def test_run_and_ident_start_from_ready_only(outcomes: Outcomes) -> None:
    """RUN also resumes from HOLD; there is no other edge into them."""
    edges = {(state, event, after) for state, event, (after, _) in outcomes if state != after}

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


def test_arming_needs_good_facts() -> None:
    """It needs a known voltage, no latched fault, no emergency stop and no shutdown."""
    for facts in all_facts():
        armed = next_state(State.SAFE, Event.ARM, facts) is State.READY
        well = facts.output_known and not (
            facts.latched or facts.estop_active or facts.shutting_down or facts.no_entry
        )

        assert armed == well


def test_adaptive_modes_need_sensor_memory_and_permission() -> None:
    """From READY and within RUN alike; the other modes need none of them."""
    for facts in all_facts():
        capable = facts.sensor_valid and facts.adapt_allowed and facts.model_known
        may_begin = not (facts.no_entry or facts.shutting_down)

        assert (not step(State.RUN, Event.RUN_ADAPTIVE, facts).refusal) == capable
        assert (not step(State.READY, Event.RUN_ADAPTIVE, facts).refusal) == (capable and may_begin)
        assert (not step(State.READY, Event.RUN, facts).refusal) == may_begin
        assert not step(State.RUN, Event.RUN, facts).refusal


def test_resume_returns_to_the_state_before_hold() -> None:
    """It returns to RUN or READY, but not while the fault is latched."""
    ready = GOOD._replace(was_running=False)

    assert next_state(State.HOLD, Event.RESUME, ready) is State.READY
    assert next_state(State.HOLD, Event.RESUME, GOOD._replace(latched=True)) is State.HOLD


def test_ramp_ends_in_safe_fault_or_stopping() -> None:
    """It ends in FAULT with a latched fault, and in STOPPING at shutdown."""
    latched = GOOD._replace(latched=True)

    assert next_state(State.RAMP, Event.AT_SAFE, GOOD) is State.SAFE
    assert next_state(State.RAMP, Event.AT_SAFE, latched) is State.FAULT
    for facts in (GOOD, latched):
        ending = facts._replace(shutting_down=True)
        assert next_state(State.RAMP, Event.AT_SAFE, ending) is State.STOPPING


def test_latched_fault_never_leads_to_safe() -> None:
    """In SAFE, BOOT and RAMP events with a latched fault lead to FAULT."""
    for state in (State.SAFE, State.BOOT, State.RAMP):
        for event in Event:
            after, refusal = step(state, event, GOOD._replace(latched=True))
            if not refusal and event is not Event.RESET:
                assert after is not State.SAFE


@pytest.mark.fault("P1")
@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("then", [Event.AT_SAFE, Event.RAMP_TIMEOUT])
def test_shutdown_ends_in_stopping_from_every_state(state: State, then: Event) -> None:
    """It ends at once or with the ramp, even if an emergency stop comes between."""
    ending = GOOD._replace(shutting_down=True, latched=True, estop_active=True)
    after = next_state(state, Event.SHUTDOWN, ending)

    assert next_state(after, then, ending) is State.STOPPING
    stopped = next_state(after, Event.ESTOP, ending)
    assert next_state(stopped, then, ending) is State.STOPPING


@pytest.mark.parametrize("event", [Event.FAULT_BLIND, Event.FAULT_CUT])
def test_shutdown_ends_at_once_if_the_amplifier_is_lost(event: Event) -> None:
    """The daemon does not wait for a voltage that cannot be reached."""
    assert next_state(State.RAMP, event, GOOD._replace(shutting_down=True)) is State.STOPPING


@pytest.mark.fault("E1")
def test_emergency_stop_ends_in_fault_when_released() -> None:
    """The safe voltage alone does not end it."""
    pressed = GOOD._replace(estop_active=True, latched=True)

    assert next_state(State.ESTOP, Event.AT_SAFE, pressed) is State.ESTOP
    assert next_state(State.ESTOP, Event.ESTOP_RELEASED, pressed) is State.ESTOP
    assert next_state(State.ESTOP, Event.ESTOP_RELEASED, GOOD) is State.FAULT


@pytest.mark.fault("E1")
def test_emergency_stop_waits_for_a_lost_amplifier() -> None:
    """It starts, or continues, from the read-back voltage, never from an older one."""
    pressed = GOOD._replace(estop_active=True, latched=True)

    assert next_state(State.ESTOP, Event.FAULT_BLIND, pressed) is State.BLIND
    assert next_state(State.BLIND, Event.ESTOP, pressed) is State.BLIND
    assert next_state(State.BLIND, Event.LINK_BACK, pressed) is State.ESTOP


def test_emergency_stop_at_an_unknown_voltage_waits_for_the_amplifier() -> None:
    """If nothing was driven, a ramp has no voltage to start at; driven axes start at theirs."""
    unknown = GOOD._replace(output_known=False)
    waits = {State.BOOT, State.SAFE, State.FAULT, State.BLIND}
    driven = {State.READY, State.RUN, State.IDENT, State.HOLD, State.RAMP, State.ESTOP}

    assert {next_state(state, Event.ESTOP, unknown) for state in waits} == {State.BLIND}
    assert {next_state(state, Event.ESTOP, unknown) for state in driven} == {State.ESTOP}


@pytest.mark.parametrize(
    "event", sorted({*Event} - {Event.ESTOP, Event.ARM, Event.LINK_BACK}, key=str)
)
@pytest.mark.parametrize("state", State)
def test_no_other_event_needs_a_known_voltage(state: State, event: Event) -> None:
    """A self-test that has passed leads to SAFE, a reset out of FAULT, and so on."""
    unknown = GOOD._replace(output_known=False)

    assert next_state(state, event, unknown) is next_state(state, event, GOOD)


def test_emergency_stop_at_shutdown_ends_at_the_safe_voltage_only() -> None:
    """Until then it goes on; in other states the safe voltage ends nothing."""
    ending = GOOD._replace(shutting_down=True, estop_active=True)

    assert next_state(State.RAMP, Event.ESTOP, ending) is State.ESTOP
    assert next_state(State.ESTOP, Event.FAULT_HOLD, ending) is State.ESTOP
    assert next_state(State.HOLD, Event.AT_SAFE, ending) is State.HOLD


def test_reset_needs_every_fault_to_be_dropped() -> None:
    """Reset leads to SAFE, never further."""
    assert next_state(State.FAULT, Event.RESET, GOOD._replace(latched=True)) is State.FAULT
    assert next_state(State.FAULT, Event.RESET, GOOD._replace(estop_active=True)) is State.FAULT
    assert next_state(State.FAULT, Event.RESET, GOOD) is State.SAFE


def test_recovered_amplifier_is_ramped_or_tested() -> None:
    """The ramp starts at the read-back; without a self-test BOOT comes first."""
    untested = GOOD._replace(self_tested=False)
    unknown = GOOD._replace(output_known=False)

    assert next_state(State.BLIND, Event.LINK_BACK, GOOD) is State.RAMP
    assert next_state(State.BLIND, Event.LINK_BACK, untested) is State.BOOT
    assert next_state(State.BLIND, Event.LINK_BACK, unknown) is State.BLIND


def test_amplifier_of_unknown_voltage_is_not_ramped() -> None:
    """It waits for a reset; an amplifier that was not driven is not ramped either."""
    unknown = GOOD._replace(output_known=False)
    idle = GOOD._replace(was_driven=False)

    assert next_state(State.BLIND, Event.OUTPUT_UNKNOWN, unknown) is State.FAULT
    assert next_state(State.BLIND, Event.LINK_BACK, idle) is State.SAFE
    assert next_state(State.BLIND, Event.LINK_BACK, idle._replace(latched=True)) is State.FAULT
    untested = unknown._replace(self_tested=False)
    assert next_state(State.BLIND, Event.OUTPUT_UNKNOWN, untested) is State.BOOT


@pytest.mark.parametrize("state", [state for state in State if state is not State.STOPPING])
def test_every_state_except_stopping_can_reach_safe(state: State) -> None:
    """There is no dead end; STOPPING ends the process."""
    reached, fresh = {state}, {state}
    while fresh:
        fresh = {next_state(s, event, GOOD) for s in fresh for event in Event} - reached
        reached |= fresh

    assert State.SAFE in reached
    assert State.STOPPING in reached


def test_refusals_are_those_of_the_list(outcomes: Outcomes) -> None:
    """Each says what is refused, in which state, and what would help, word by word."""
    listed = Path(__file__).with_name("refusals.txt").read_text(encoding="utf-8").splitlines()

    assert {outcome.refusal for _, _, outcome in outcomes if outcome.refusal} == {*listed}


def test_refusal_names_the_remedy() -> None:
    """The text is for people, with the verb to use."""
    refusal = step(State.SAFE, Event.RUN, GOOD).refusal
    no_entry = step(State.SAFE, Event.ARM, GOOD._replace(no_entry="the disk is full")).refusal

    assert refusal == "cannot move in SAFE: `piezod arm` first"
    assert no_entry == "cannot arm in SAFE: the disk is full"
