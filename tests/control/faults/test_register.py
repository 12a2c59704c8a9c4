"""What becomes of faults from cycle to cycle."""

import pytest

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.faults.register import CAUSE_CYCLES, GOOD_CYCLES, Detection
from piezod.control.faults.table import FAULTS, INDEX, FaultRule, Reaction, ids, mask
from tests.control.registered import S5, SECOND, Stage


@pytest.fixture
def stage() -> Stage:
    """A stage without a fault."""
    return Stage()


def test_faults_go_after_twenty_cycles_and_explain_others_for_ten() -> None:
    """Numbers that the documentation names."""
    assert (GOOD_CYCLES, CAUSE_CYCLES) == (20, 10)


def test_without_a_fault_nothing_happens(stage: Stage) -> None:
    """No reaction, no news, no mask."""
    assert set(stage.cycles(100)) == {Reaction.NONE}
    assert (stage.present, stage.latched, stage.told) == ([], [], [])


@pytest.mark.parametrize("rule", FAULTS, ids=lambda rule: rule.id)
def test_each_fault_has_its_reaction_at_once_and_only_once(stage: Stage, rule: FaultRule) -> None:
    """In the cycle in which it is found; while it stays it is not new."""
    assert stage.cycle(rule.id) is rule.reaction
    assert stage.cycle(rule.id) is Reaction.NONE
    assert stage.present == [rule.id]
    assert stage.latched == ([rule.id] if rule.latch else [])
    assert stage.told == [(rule.id, True)]


def test_the_worst_reaction_wins(stage: Stage) -> None:
    """In whichever order the watches tell."""
    assert stage.cycle(Fault.L4, Fault.A3, Fault.A12, Fault.S5) is Reaction.CUT


def test_a_fault_is_gone_after_twenty_good_cycles(stage: Stage) -> None:
    """Not after nineteen; being found once more, it starts to count anew."""
    stage.cycle(Fault.A6)
    stage.cycles(GOOD_CYCLES - 1)
    assert stage.present == [Fault.A6]
    stage.cycle(Fault.A6)
    stage.cycles(GOOD_CYCLES - 1)
    assert stage.present == [Fault.A6]
    stage.cycle()

    assert stage.present == []
    assert stage.told == [(Fault.A6, True), (Fault.A6, False)]


def test_a_latched_fault_stays_until_somebody_ends_it(stage: Stage) -> None:
    """It is no longer present, but latched; its end is told when it is dropped."""
    stage.cycle(Fault.S5)
    stage.cycles(10 * SECOND)
    assert (stage.present, stage.latched) == ([], [Fault.S5])
    assert stage.register.resume() == ""
    stage.cycles(3)

    assert stage.latched == []
    assert stage.told == [(Fault.S5, True), (Fault.S5, False)]


def test_resume_waits_for_the_fault_to_go(stage: Stage) -> None:
    """Twenty good cycles; then it drops what is latched until `resume`."""
    stage.cycle(Fault.S5)
    stage.cycles(GOOD_CYCLES - 1)
    why = stage.register.resume()

    assert why == "S5 is present: no valid sample; check cable, power and light of the sensor"
    stage.cycle()
    assert stage.register.resume() == ""


def test_resume_does_not_drop_what_needs_a_reset(stage: Stage) -> None:
    """And drops nothing else then, either."""
    stage.cycle(Fault.A3, Fault.S5)
    stage.cycles(SECOND)

    assert stage.register.resume().startswith("A3 was found: ")
    assert Fault.A3 in stage.latched


def test_reset_needs_the_fault_gone_for_a_second(stage: Stage) -> None:
    """Not a cycle less."""
    stage.cycle(Fault.A3)
    stage.cycles(SECOND - 1)
    assert stage.register.reset(engineer=True).startswith("A3 was found: ")
    stage.cycle()

    assert stage.register.reset(engineer=False) == ""
    assert stage.latched == []


def test_the_gravest_faults_need_an_engineer(stage: Stage) -> None:
    """An operator is told so."""
    stage.cycle(Fault.A12)
    stage.cycles(SECOND)

    assert "an engineer's `piezod reset`" in stage.register.reset(engineer=False)
    assert stage.latched == [Fault.A12]
    assert stage.register.reset(engineer=True) == ""
    assert stage.latched == []


def test_reset_drops_what_resume_would(stage: Stage) -> None:
    """After a ramp there is nothing to resume; twenty good cycles are enough."""
    stage.cycle(Fault.L5)
    stage.cycles(GOOD_CYCLES)

    assert stage.register.reset(engineer=False) == ""
    assert stage.latched == []


def test_reset_tells_where_it_could_drop_nothing(stage: Stage) -> None:
    """Also of faults that only forbid to adapt; a stopped stage may leave those."""
    stage.cycle(Fault.D1)
    assert stage.register.reset(engineer=False).startswith("D1 is present: ")
    stage.cycles(SECOND)
    stage.cycle(Fault.A3)
    stage.cycles(SECOND)
    stage.cycle(Fault.D5)

    assert stage.register.reset(engineer=False) == ""
    assert stage.latched == [Fault.D5]


def test_only_faults_that_stop_the_stage_forbid_to_arm(stage: Stage) -> None:
    """Present or latched; only what needs a reset leads from the ramp to FAULT."""
    stage.cycle(Fault.D1, Fault.A6, Fault.L7)
    assert (stage.register.no_entry, stage.register.blocking) == ("", 0)
    stage.cycles(CAUSE_CYCLES)
    stage.cycle(Fault.S5)
    assert stage.register.no_entry.startswith("S5 is present: ")
    assert stage.register.blocking == 0
    stage.cycle(Fault.A3)
    assert stage.register.blocking == mask([Fault.A3])
    stage.cycles(SECOND)
    assert stage.register.no_entry.startswith(("S5 was found: ", "A3 was found: "))
    stage.register.reset(engineer=False)

    assert (stage.register.no_entry, stage.register.blocking) == ("", 0)


@pytest.mark.parametrize(("fault", "last_cycle"), [(Fault.A3, 7), (Fault.A4, 9), (Fault.S9, 20)])
def test_a_fault_that_stays_for_cycles_becomes_worse(
    stage: Stage, fault: Fault, last_cycle: int
) -> None:
    """HOLD becomes RAMP, once, in the cycle that the table names."""
    reactions = stage.cycles(50, fault)

    assert [k for k, r in enumerate(reactions) if r is Reaction.HOLD] == [0]
    assert [k for k, r in enumerate(reactions) if r is Reaction.RAMP] == [last_cycle]
    assert stage.told == [(fault, True)] * 2
    assert ids(stage.register.blocking) == [fault]


@pytest.mark.fault("S5")
@pytest.mark.fault("A1")
@pytest.mark.parametrize(
    ("fault", "worse"), [(Fault.S5, Reaction.RAMP), (Fault.A1, Reaction.BLIND)]
)
def test_a_fault_that_stays_for_a_second_needs_a_reset(
    stage: Stage, fault: Fault, worse: Reaction
) -> None:
    """Below that, `resume` ends it."""
    before = stage.cycles(SECOND, fault)
    assert set(before[1:]) == {Reaction.NONE}
    assert stage.register.blocking == 0

    assert stage.cycle(fault) is worse
    assert ids(stage.register.blocking) == [fault]


def test_a_fault_that_comes_back_reacts_anew_but_keeps_its_latch(stage: Stage) -> None:
    """Once it needed a reset it needs one, though the second time was short."""
    stage.cycles(SECOND + 1, Fault.S5)
    stage.cycles(GOOD_CYCLES)

    assert stage.cycle(Fault.S5) is Reaction.HOLD
    assert ids(stage.register.blocking) == [Fault.S5]


def test_a_consequence_is_not_told_with_its_cause(stage: Stage) -> None:
    """Though the watch of the consequence tells first."""
    reaction = stage.cycle(Fault.S5, Fault.A1)

    assert reaction is Reaction.BLIND
    assert (stage.present, stage.latched) == ([Fault.A1], [Fault.A1])


def test_a_consequence_that_outlasts_its_cause_is_a_fault(stage: Stage) -> None:
    """Ten cycles after the cause appeared."""
    reactions = [stage.cycle(Fault.L2), *stage.cycles(CAUSE_CYCLES + 1, Fault.S5)]

    assert reactions == [Reaction.HOLD] + [Reaction.NONE] * CAUSE_CYCLES + [Reaction.HOLD]
    assert stage.told == [(Fault.L2, True), (Fault.S5, True)]


def test_a_mild_cause_excuses_nothing_grave(stage: Stage) -> None:
    """A single late cycle does not hide a stuck sensor."""
    assert stage.cycle(Fault.L1, Fault.S1) is Reaction.HOLD
    assert stage.present == [Fault.S1, Fault.L1]


def test_what_concerns_the_process_is_never_a_consequence(stage: Stage) -> None:
    """A failed control law is told beside a hung bus."""
    stage.cycle(Fault.B1, Fault.P4)

    assert stage.present == [Fault.B1, Fault.P4]


def test_two_faults_of_one_source_hold_once(stage: Stage) -> None:
    """A sensor that gives no number soon gives no sample: one trouble, both told, one HOLD."""
    assert stage.cycle(Fault.S5) is Reaction.HOLD
    stage.cycles(3, Fault.S5)

    assert stage.cycle(Fault.S5, Fault.S2) is Reaction.NONE
    assert stage.present == [Fault.S2, Fault.S5]


def test_a_fault_of_another_source_holds_again(stage: Stage) -> None:
    """The state machine then makes RAMP of it."""
    stage.cycle(Fault.S5)
    stage.cycles(CAUSE_CYCLES, Fault.S5)

    assert stage.cycle(Fault.S5, Fault.A3) is Reaction.HOLD


def test_a_cause_that_is_found_after_its_consequence_is_no_second_trouble(stage: Stage) -> None:
    """It is told, and what is held is held once."""
    stage.cycle(Fault.S5)

    assert stage.cycle(Fault.S5, Fault.A3) is Reaction.NONE
    assert stage.present == [Fault.S5, Fault.A3]


def test_a_fault_that_comes_to_another_axis_is_new(stage: Stage) -> None:
    """It is told for each axis, and reacted to for each."""
    first = stage.cycle(Detection(Fault.D1, 0))
    second = stage.cycle(Detection(Fault.D1, 0), Detection(Fault.D1, 1))
    third = stage.cycle(Detection(Fault.D1, 1), Detection(Fault.D1, 0))

    assert (first, second, third) == (Reaction.DEGRADE, Reaction.DEGRADE, Reaction.NONE)
    assert stage.told == [(Fault.D1, True)] * 2


def test_a_hold_for_another_axis_is_no_second_one(stage: Stage) -> None:
    """All axes are held already; it is told all the same."""
    stage.cycle(S5)

    assert stage.cycle(S5, S5._replace(axis=1)) is Reaction.NONE
    assert stage.told == [(Fault.S5, True)] * 2


def test_a_milder_case_of_a_latched_fault_counts_for_nothing(stage: Stage) -> None:
    """It is over when what tripped is over; what ends it stays."""
    stage.cycle(Fault.B3)
    stage.cycles(GOOD_CYCLES - 1)
    stage.cycle(Detection(Fault.B3, case=Case.SINGLE))

    assert stage.present == []
    assert stage.register.no_entry.startswith("B3 was found: ")


def test_a_worse_case_of_a_fault_is_new_and_a_milder_one_is_not(stage: Stage) -> None:
    """A sensor is lost, then the amplifier, then they are told together."""
    sensor, amplifier = Detection(Fault.B1, 0, case=Case.SENSOR), Detection(Fault.B1, 0)
    reactions = [stage.cycle(sensor), stage.cycle(amplifier, sensor), stage.cycle(sensor)]

    assert reactions == [Reaction.HOLD, Reaction.BLIND, Reaction.NONE]
    assert stage.register.unreachable
    assert stage.told == [(Fault.B1, True)] * 2


def test_resume_leaves_what_forbids_to_adapt(stage: Stage) -> None:
    """It needs a reset, but keeps nobody from going on."""
    stage.cycle(Fault.D1)
    stage.cycles(CAUSE_CYCLES, Fault.D1)
    stage.cycle(Fault.S5)
    stage.cycles(GOOD_CYCLES)

    assert stage.register.resume() == ""
    assert stage.latched == [Fault.D1]


def test_a_fault_of_all_axes_is_not_new_on_one_of_them(stage: Stage) -> None:
    """It is there already."""
    stage.cycle(Detection(Fault.D1))

    assert stage.cycle(Detection(Fault.D1, 0), Detection(Fault.D1, 3)) is Reaction.NONE


def test_a_fault_that_was_dropped_begins_anew(stage: Stage) -> None:
    """With the reaction and latch that it has at first."""
    stage.cycles(SECOND + 1, Fault.S5)
    stage.cycles(SECOND)
    stage.register.reset(engineer=False)

    assert stage.cycle(Fault.S5) is Reaction.HOLD
    assert stage.register.blocking == 0


def test_a_reset_tells_what_it_had_to_leave(stage: Stage) -> None:
    """Though it dropped something."""
    stage.cycle(Fault.A3, Fault.A12)
    stage.cycles(SECOND)

    assert stage.register.reset(engineer=False).startswith("A12 was found: ")
    assert stage.latched == [Fault.A12]


@pytest.mark.fault("D6")
def test_an_oscillation_is_told_then_ends_adapting_then_holds_the_stage(stage: Stage) -> None:
    """At once, after half a second and after a second, each once."""
    reactions = stage.cycles(SECOND + 2, Fault.D6)
    changes = [(k, r) for k, r in enumerate(reactions) if r is not Reaction.NONE]

    assert changes == [
        (0, Reaction.WARN),
        (SECOND // 2, Reaction.DEGRADE),
        (SECOND, Reaction.HOLD),
    ]


@pytest.mark.fault("D6")
def test_an_oscillation_forbids_to_adapt_only_when_half_the_gain_has_not_helped(
    stage: Stage,
) -> None:
    """Until then it is told and latched."""
    stage.cycle(Fault.D6)
    before = stage.register.adapt_allowed, stage.latched
    stage.cycles(SECOND // 2, Fault.D6)

    assert before == (True, [Fault.D6])
    assert not stage.register.adapt_allowed
    assert stage.register.axes_of(Fault.D6) == -1


def test_a_mild_fault_of_the_same_source_keeps_nothing_from_holding(stage: Stage) -> None:
    """Late samples, then none."""
    stage.cycle(Fault.S6)
    stage.cycles(CAUSE_CYCLES, Fault.S6)

    assert stage.cycle(Fault.S6, Fault.S5) is Reaction.HOLD


def test_news_carry_what_was_measured(stage: Stage) -> None:
    """The value and the limit that it was compared with, and the rule that holds now."""
    stage.cycle(S5)

    assert stage.register.news == [(FAULTS[INDEX[Fault.S5]], S5, True)]


def test_news_of_an_escalation_carry_the_worse_reaction(stage: Stage) -> None:
    """What the log shows is what is done."""
    stage.cycles(7, Fault.A3)
    stage.cycle(Fault.A3)

    assert [news.rule.reaction for news in stage.register.news] == [Reaction.RAMP]
