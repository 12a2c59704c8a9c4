"""Tests of the fault register: appearance, end, latch, consequence and escalation."""

import pytest

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.faults.detection import Detection
from piezod.control.faults.register import CAUSE_CYCLES, GOOD_CYCLES
from piezod.control.faults.table import FAULTS, INDEX, FaultRule, Reaction, ids, mask
from tests.control.register_bench import S5, SECOND, RegisterBench


@pytest.fixture
def bench() -> RegisterBench:
    """Return a register without a fault."""
    return RegisterBench()


def test_faults_end_after_twenty_cycles_and_are_causes_for_ten() -> None:
    """The documentation names these numbers."""
    assert (GOOD_CYCLES, CAUSE_CYCLES) == (20, 10)


def test_without_a_fault_nothing_happens(bench: RegisterBench) -> None:
    """Without a detection there is no reaction, no change and no mask."""
    assert set(bench.cycles(100)) == {Reaction.NONE}
    assert (bench.present, bench.latched, bench.changes) == ([], [], [])


@pytest.mark.parametrize("rule", FAULTS, ids=lambda rule: rule.id)
def test_each_fault_has_its_reaction_at_once_and_only_once(
    bench: RegisterBench, rule: FaultRule
) -> None:
    """The reaction comes in the first cycle of a fault; while the fault stays it is not new."""
    assert bench.cycle(rule.id) is rule.reaction
    assert bench.cycle(rule.id) is Reaction.NONE
    assert bench.present == [rule.id]
    assert bench.latched == ([rule.id] if rule.latch else [])
    assert bench.changes == [(rule.id, True)]


def test_most_severe_reaction_wins(bench: RegisterBench) -> None:
    """The order of the detections does not matter."""
    assert bench.cycle(Fault.L4, Fault.A3, Fault.A12, Fault.S5) is Reaction.CUT


def test_fault_is_gone_after_twenty_good_cycles(bench: RegisterBench) -> None:
    """One more detection restarts the count."""
    bench.cycle(Fault.A6)
    bench.cycles(GOOD_CYCLES - 1)
    assert bench.present == [Fault.A6]
    bench.cycle(Fault.A6)
    bench.cycles(GOOD_CYCLES - 1)
    assert bench.present == [Fault.A6]
    bench.cycle()

    assert bench.present == []
    assert bench.changes == [(Fault.A6, True), (Fault.A6, False)]


def test_latched_fault_stays_until_a_request_ends_it(bench: RegisterBench) -> None:
    """The fault is latched without being present; its end is reported when it is dropped."""
    bench.cycle(Fault.S5)
    bench.cycles(10 * SECOND)
    assert (bench.present, bench.latched) == ([], [Fault.S5])
    assert bench.register.resume() == ""
    bench.cycles(3)

    assert bench.latched == []
    assert bench.changes == [(Fault.S5, True), (Fault.S5, False)]


def test_resume_waits_for_the_fault_to_go(bench: RegisterBench) -> None:
    """Resume drops the fault after twenty good cycles, not before."""
    bench.cycle(Fault.S5)
    bench.cycles(GOOD_CYCLES - 1)
    why = bench.register.resume()

    assert why == "S5 is present: no valid sample; check cable, power and light of the sensor"
    bench.cycle()
    assert bench.register.resume() == ""


def test_resume_drops_nothing_if_a_fault_needs_a_reset(bench: RegisterBench) -> None:
    """The faults that resume could drop stay, too."""
    bench.cycle(Fault.A3, Fault.S5)
    bench.cycles(SECOND)

    assert bench.register.resume().startswith("A3 was found: ")
    assert Fault.A3 in bench.latched


def test_reset_needs_the_fault_gone_for_a_second(bench: RegisterBench) -> None:
    """Reset drops a fault that has been gone for a second, not a cycle less."""
    bench.cycle(Fault.A3)
    bench.cycles(SECOND - 1)
    assert bench.register.reset(engineer=True).startswith("A3 was found: ")
    bench.cycle()

    assert bench.register.reset(engineer=False) == ""
    assert bench.latched == []


def test_faults_of_latch_l3_need_an_engineer(bench: RegisterBench) -> None:
    """The refusal of an operator's reset says so."""
    bench.cycle(Fault.A12)
    bench.cycles(SECOND)

    assert "`piezod reset --engineer`" in bench.register.reset(engineer=False)
    assert bench.latched == [Fault.A12]
    assert bench.register.reset(engineer=True) == ""
    assert bench.latched == []


def test_reset_drops_faults_that_resume_drops(bench: RegisterBench) -> None:
    """After a ramp nothing can be resumed; twenty good cycles are enough for such faults."""
    bench.cycle(Fault.L5)
    bench.cycles(GOOD_CYCLES)

    assert bench.register.reset(engineer=False) == ""
    assert bench.latched == []


def test_reset_reports_if_it_dropped_nothing(bench: RegisterBench) -> None:
    """This holds for faults that only forbid adaptation, too; a stopped stage may keep those."""
    bench.cycle(Fault.D1)
    assert bench.register.reset(engineer=False).startswith("D1 is present: ")
    bench.cycles(SECOND)
    bench.cycle(Fault.A3)
    bench.cycles(SECOND)
    bench.cycle(Fault.D2)

    assert bench.register.reset(engineer=False) == ""
    assert bench.latched == [Fault.D2]


def test_only_faults_that_stop_the_stage_forbid_arming(bench: RegisterBench) -> None:
    """They do so while present or latched; only faults that need a reset block the stage."""
    bench.cycle(Fault.D1, Fault.A6, Fault.L7)
    assert (bench.register.no_entry, bench.register.blocking) == ("", 0)
    bench.cycles(CAUSE_CYCLES)
    bench.cycle(Fault.S5)
    assert bench.register.no_entry.startswith("S5 is present: ")
    assert bench.register.blocking == 0
    bench.cycle(Fault.A3)
    assert bench.register.blocking == mask([Fault.A3])
    bench.cycles(SECOND)
    assert bench.register.no_entry.startswith(("S5 was found: ", "A3 was found: "))
    bench.register.reset(engineer=False)

    assert (bench.register.no_entry, bench.register.blocking) == ("", 0)


@pytest.mark.parametrize(("fault", "last_cycle"), [(Fault.A3, 7), (Fault.A4, 9), (Fault.S9, 20)])
def test_fault_that_stays_for_cycles_escalates(
    bench: RegisterBench, fault: Fault, last_cycle: int
) -> None:
    """HOLD becomes RAMP once, in the cycle that the table names."""
    reactions = bench.cycles(50, fault)

    assert [k for k, r in enumerate(reactions) if r is Reaction.HOLD] == [0]
    assert [k for k, r in enumerate(reactions) if r is Reaction.RAMP] == [last_cycle]
    assert bench.changes == [(fault, True)] * 2
    assert ids(bench.register.blocking) == [fault]


@pytest.mark.fault("S5")
@pytest.mark.fault("A1")
@pytest.mark.parametrize(
    ("fault", "worse"), [(Fault.S5, Reaction.RAMP), (Fault.A1, Reaction.BLIND)]
)
def test_fault_that_stays_for_a_second_needs_a_reset(
    bench: RegisterBench, fault: Fault, worse: Reaction
) -> None:
    """Before that, `resume` ends it."""
    before = bench.cycles(SECOND, fault)
    assert set(before[1:]) == {Reaction.NONE}
    assert bench.register.blocking == 0

    assert bench.cycle(fault) is worse
    assert ids(bench.register.blocking) == [fault]


def test_fault_that_returns_reacts_again_and_keeps_its_latch(bench: RegisterBench) -> None:
    """A fault that needed a reset still needs it, even if it returns only briefly."""
    bench.cycles(SECOND + 1, Fault.S5)
    bench.cycles(GOOD_CYCLES)

    assert bench.cycle(Fault.S5) is Reaction.HOLD
    assert ids(bench.register.blocking) == [Fault.S5]


def test_consequence_is_suppressed_by_its_cause(bench: RegisterBench) -> None:
    """The order in which the watches report does not matter."""
    reaction = bench.cycle(Fault.S5, Fault.A1)

    assert reaction is Reaction.BLIND
    assert (bench.present, bench.latched) == ([Fault.A1], [Fault.A1])


def test_consequence_that_outlasts_its_cause_is_a_fault(bench: RegisterBench) -> None:
    """It appears ten cycles after its cause appeared."""
    reactions = [bench.cycle(Fault.L2), *bench.cycles(CAUSE_CYCLES + 1, Fault.S5)]

    assert reactions == [Reaction.HOLD] + [Reaction.NONE] * CAUSE_CYCLES + [Reaction.HOLD]
    assert bench.changes == [(Fault.L2, True), (Fault.S5, True)]


def test_mild_cause_suppresses_no_severe_fault(bench: RegisterBench) -> None:
    """A single late cycle does not hide a stuck sensor."""
    assert bench.cycle(Fault.L1, Fault.S1) is Reaction.HOLD
    assert bench.present == [Fault.S1, Fault.L1]


def test_faults_of_the_process_are_never_consequences(bench: RegisterBench) -> None:
    """A failed control law is reported together with a lost device."""
    bench.cycle(Fault.B1, Fault.P4)

    assert bench.present == [Fault.B1, Fault.P4]


def test_two_faults_of_one_source_hold_once(bench: RegisterBench) -> None:
    """A sensor without numbers soon has no samples: both faults are reported, with one HOLD."""
    assert bench.cycle(Fault.S5) is Reaction.HOLD
    bench.cycles(3, Fault.S5)

    assert bench.cycle(Fault.S5, Fault.S2) is Reaction.NONE
    assert bench.present == [Fault.S2, Fault.S5]


def test_fault_of_another_source_holds_again(bench: RegisterBench) -> None:
    """The state machine turns the second HOLD into RAMP."""
    bench.cycle(Fault.S5)
    bench.cycles(CAUSE_CYCLES, Fault.S5)

    assert bench.cycle(Fault.S5, Fault.A3) is Reaction.HOLD


def test_cause_found_after_its_consequence_does_not_hold_again(bench: RegisterBench) -> None:
    """The cause is reported without a second HOLD."""
    bench.cycle(Fault.S5)

    assert bench.cycle(Fault.S5, Fault.A3) is Reaction.NONE
    assert bench.present == [Fault.S5, Fault.A3]


def test_fault_on_another_axis_is_new(bench: RegisterBench) -> None:
    """The fault is reported, with its reaction, once for each axis."""
    first = bench.cycle(Detection(Fault.D1, 0))
    second = bench.cycle(Detection(Fault.D1, 0), Detection(Fault.D1, 1))
    third = bench.cycle(Detection(Fault.D1, 1), Detection(Fault.D1, 0))

    assert (first, second, third) == (Reaction.DEGRADE, Reaction.DEGRADE, Reaction.NONE)
    assert bench.changes == [(Fault.D1, True)] * 2


def test_fault_on_another_axis_does_not_hold_again(bench: RegisterBench) -> None:
    """All axes are held already; the fault is reported for the other axis."""
    bench.cycle(S5)

    assert bench.cycle(S5, S5._replace(axis=1)) is Reaction.NONE
    assert bench.changes == [(Fault.S5, True)] * 2


def test_single_event_does_not_keep_a_latched_fault_present(bench: RegisterBench) -> None:
    """The fault is over; its latch stays."""
    bench.cycle(Fault.B3)
    bench.cycles(GOOD_CYCLES - 1)
    bench.cycle(Detection(Fault.B3, case=Case.SINGLE))

    assert bench.present == []
    assert bench.register.no_entry.startswith("B3 was found: ")


def test_more_severe_case_is_new_and_milder_one_is_not(bench: RegisterBench) -> None:
    """A sensor is lost, then the amplifier; then both are reported together."""
    sensor, amplifier = Detection(Fault.B1, 0, case=Case.SENSOR), Detection(Fault.B1, 0)
    reactions = [bench.cycle(sensor), bench.cycle(amplifier, sensor), bench.cycle(sensor)]

    assert reactions == [Reaction.HOLD, Reaction.BLIND, Reaction.NONE]
    assert bench.register.unreachable
    assert bench.changes == [(Fault.B1, True)] * 2


def test_resume_keeps_faults_that_forbid_adaptation(bench: RegisterBench) -> None:
    """Such a fault needs a reset, but does not stop the stage."""
    bench.cycle(Fault.D1)
    bench.cycles(CAUSE_CYCLES, Fault.D1)
    bench.cycle(Fault.S5)
    bench.cycles(GOOD_CYCLES)

    assert bench.register.resume() == ""
    assert bench.latched == [Fault.D1]


def test_fault_of_all_axes_is_not_new_on_one_of_them(bench: RegisterBench) -> None:
    """A fault that concerns all axes is present on each."""
    bench.cycle(Detection(Fault.D1))

    assert bench.cycle(Detection(Fault.D1, 0), Detection(Fault.D1, 3)) is Reaction.NONE


def test_fault_that_was_dropped_starts_again(bench: RegisterBench) -> None:
    """It has its first reaction and its first latch."""
    bench.cycles(SECOND + 1, Fault.S5)
    bench.cycles(SECOND)
    bench.register.reset(engineer=False)

    assert bench.cycle(Fault.S5) is Reaction.HOLD
    assert bench.register.blocking == 0


def test_reset_reports_the_faults_that_it_kept(bench: RegisterBench) -> None:
    """It reports them although it dropped another fault."""
    bench.cycle(Fault.A3, Fault.A12)
    bench.cycles(SECOND)

    assert bench.register.reset(engineer=False).startswith("A12 was found: ")
    assert bench.latched == [Fault.A12]


@pytest.mark.fault("D6")
def test_oscillation_warns_then_degrades_then_holds(bench: RegisterBench) -> None:
    """The reactions come at once, after half a second and after a second, each once."""
    reactions = bench.cycles(SECOND + 2, Fault.D6)
    changes = [(k, r) for k, r in enumerate(reactions) if r is not Reaction.NONE]

    assert changes == [
        (0, Reaction.WARN),
        (SECOND // 2, Reaction.DEGRADE),
        (SECOND, Reaction.HOLD),
    ]


@pytest.mark.fault("D6")
def test_oscillation_forbids_adaptation_after_half_a_second(
    bench: RegisterBench,
) -> None:
    """Before that, with half the gain, it is only reported and latched."""
    bench.cycle(Fault.D6)
    before = bench.register.adapt_allowed, bench.latched
    bench.cycles(SECOND // 2, Fault.D6)

    assert before == (True, [Fault.D6])
    assert not bench.register.adapt_allowed
    assert bench.register.axes_of(Fault.D6) == -1


def test_mild_fault_of_the_same_source_prevents_no_hold(bench: RegisterBench) -> None:
    """Late samples do not prevent the HOLD of missing samples."""
    bench.cycle(Fault.S6)
    bench.cycles(CAUSE_CYCLES, Fault.S6)

    assert bench.cycle(Fault.S6, Fault.S5) is Reaction.HOLD


def test_news_contain_value_and_limit(bench: RegisterBench) -> None:
    """News contain the rule that holds now, the measured value and its limit."""
    bench.cycle(S5)

    assert bench.register.news == [(FAULTS[INDEX[Fault.S5]], S5, True)]


def test_news_of_an_escalation_contain_the_new_reaction(bench: RegisterBench) -> None:
    """The log shows the reaction that is in effect."""
    bench.cycles(7, Fault.A3)
    bench.cycle(Fault.A3)

    assert [news.rule.reaction for news in bench.register.news] == [Reaction.RAMP]


def test_restored_faults_are_latched_and_not_present(bench: RegisterBench) -> None:
    """The faults of the loop before need the same request as there, and cause no reaction."""
    bench.register.restore(mask([Fault.E1, Fault.S10, Fault.A9]), stopped=True)

    assert bench.cycle() is Reaction.NONE
    assert (bench.present, set(bench.latched)) == ([], {Fault.E1, Fault.S10, Fault.A9})
    bench.cycles(SECOND)
    assert "S10 was found" in bench.register.reset(engineer=False)
    assert bench.latched == [Fault.S10]
    assert bench.register.reset(engineer=True) == ""


@pytest.mark.parametrize(("stopped", "blocks"), [(True, True), (False, False)])
def test_restored_fault_keeps_its_escalation(
    bench: RegisterBench, stopped: bool, blocks: bool
) -> None:
    """A missing sample that had stopped the stage needs a reset; one that had not does not."""
    bench.register.restore(mask([Fault.S5]), stopped=stopped)
    bench.cycle()

    assert bool(bench.register.blocking) is blocks
