"""Tests of details of the fault register: masks, axes, news, and the limits of its times."""

import pytest

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.faults.detection import Detection, News
from piezod.control.faults.register import CAUSE_CYCLES, GOOD_CYCLES
from piezod.control.faults.table import FAULTS, INDEX, Reaction, mask
from tests.control.register_bench import S5, SECOND, RegisterBench

D1 = Detection(Fault.D1, 0, 2.0, 1.0)


@pytest.fixture
def bench() -> RegisterBench:
    """Return a register without a fault."""
    return RegisterBench()


def test_axes_of_a_fault_are_bits(bench: RegisterBench) -> None:
    """There are none before the fault and after its end."""
    before = bench.register.axes_of(Fault.D1)
    bench.cycle(Detection(Fault.D1, 0))
    first = bench.register.axes_of(Fault.D1)
    bench.cycle(Detection(Fault.D1, 2))
    both = bench.register.axes_of(Fault.D1)
    bench.cycles(SECOND)
    bench.register.reset(engineer=False)

    assert (before, first, both, bench.register.axes_of(Fault.D1)) == (0, 1, 5, 0)


def test_fault_without_a_latch_leaves_no_axis(bench: RegisterBench) -> None:
    """It ends by itself."""
    bench.cycle(Detection(Fault.A6, 0))
    bench.cycles(GOOD_CYCLES)

    assert bench.register.axes_of(Fault.A6) == 0


def test_latched_fault_that_returns_on_another_axis_keeps_the_first(bench: RegisterBench) -> None:
    """Both need the reset."""
    bench.cycle(Detection(Fault.D1, 0))
    bench.cycles(GOOD_CYCLES)
    bench.cycle(Detection(Fault.D1, 1))

    assert bench.register.axes_of(Fault.D1) == 3


def test_more_severe_case_of_an_unlatched_fault_is_that_of_its_axis(bench: RegisterBench) -> None:
    """Single events on another axis are not part of it."""
    bench.cycle(Detection(Fault.B3, 0, case=Case.SINGLE))
    latched = bench.latched
    bench.cycle(Detection(Fault.B3, 1))

    assert latched == []
    assert bench.register.axes_of(Fault.B3) == 2


def test_restored_faults_have_all_axes_and_join_the_others(bench: RegisterBench) -> None:
    """The axes are not known any more; a fault that is latched already stays so."""
    bench.cycle(Fault.A3)
    bench.register.restore(mask([Fault.E1]), stopped=True)

    assert bench.register.axes_of(Fault.E1) == -1
    assert bench.register.latched == mask([Fault.A3, Fault.E1])


def test_restored_fault_must_be_gone_for_a_second_of_this_loop(bench: RegisterBench) -> None:
    """Not a cycle less."""
    bench.register.restore(mask([Fault.A3]), stopped=True)
    bench.cycles(SECOND - 1)
    early = bench.register.reset(engineer=True)
    bench.cycle()

    assert early.startswith("A3 was found: ")
    assert bench.register.reset(engineer=True) == ""


def test_news_of_a_restored_fault_have_its_escalated_rule(bench: RegisterBench) -> None:
    """It was never detected by this loop."""
    bench.register.restore(mask([Fault.S5]), stopped=True)
    bench.cycles(SECOND)
    bench.register.reset(engineer=False)
    bench.cycle()
    (news,) = bench.register.news

    assert news.rule.reaction is Reaction.RAMP
    assert (news.detection.fault, news.appeared) == (Fault.S5, False)


def test_news_of_an_end_have_the_last_detection(bench: RegisterBench) -> None:
    """With its value, for a fault that ends by itself and for one that is dropped."""
    usual, last = Detection(Fault.A6, 0, 1.0, 1.0), Detection(Fault.A6, 0, 3.0, 1.0)
    bench.cycle(usual)
    bench.cycle(last)
    bench.cycles(GOOD_CYCLES)
    ended = list(bench.register.news)
    bench.cycle(D1)
    bench.cycles(SECOND)
    bench.register.reset(engineer=False)
    bench.cycle()

    assert ended == [News(FAULTS[INDEX[Fault.A6]], last, False)]
    assert bench.register.news == [News(FAULTS[INDEX[Fault.D1]], D1, False)]


def test_news_of_another_axis_and_of_an_escalation_have_their_detection(
    bench: RegisterBench,
) -> None:
    """The value is that of the cycle."""
    other = D1._replace(axis=1, measured=5.0)
    bench.cycle(D1)
    bench.cycle(D1, other)
    of_axis = [news.detection for news in bench.register.news]
    bench.cycles(SECOND)
    late = S5._replace(measured=9.0)
    for _ in range(SECOND):
        bench.cycle(S5)
    bench.cycle(late)

    assert of_axis == [other]
    assert [news.detection for news in bench.register.news] == [late]


def test_cause_comes_first_whatever_the_names_are(bench: RegisterBench) -> None:
    """A late loop is the cause of an amplifier that differs."""
    assert bench.cycle(Fault.A3, Fault.L2) is Reaction.HOLD
    assert bench.present == [Fault.L2]


def test_adaptation_is_forbidden_while_a_fault_is_latched(bench: RegisterBench) -> None:
    """It need not be present; a reset allows it again."""
    bench.cycle(Fault.D1)
    present = bench.register.adapt_allowed
    bench.cycles(GOOD_CYCLES)
    gone = bench.register.adapt_allowed
    bench.cycles(SECOND)
    bench.register.reset(engineer=False)

    assert (present, gone, bench.register.adapt_allowed) == (False, False, True)


def test_tripped_watchdog_waits_for_a_write(bench: RegisterBench) -> None:
    """Its amplifier counts as reachable; a lost one does not, even beside it."""
    bench.cycle(Fault.A9)
    tripped = bool(bench.register.unreachable)
    bench.cycles(CAUSE_CYCLES, Fault.A9)
    bench.cycle(Fault.A9, Fault.B1)

    assert (tripped, bool(bench.register.unreachable)) == (False, True)


def test_axes_are_blind_by_any_of_their_faults(bench: RegisterBench) -> None:
    """Each fault adds its axes; a tripped watchdog makes its axis blind, too, but reachable."""
    bench.cycle(Detection(Fault.A9, 0))
    bench.cycles(CAUSE_CYCLES)
    bench.cycle(Detection(Fault.B1, 1))

    assert bench.register.blind == 0b11
    assert bench.register.unreachable == 0b10


def test_lateness_alone_needs_no_person(bench: RegisterBench) -> None:
    """Any other fault that stops the stage does, also after it is gone."""
    bench.cycle(Fault.L2)
    late = bench.register.needs_person
    bench.cycles(CAUSE_CYCLES, Fault.L2)
    bench.cycle(Fault.S5, Fault.L2)
    lost = bench.register.needs_person
    bench.cycles(GOOD_CYCLES)

    assert (late, lost, bench.register.needs_person) == (False, True, True)


def test_masks_have_all_faults(bench: RegisterBench) -> None:
    """Two faults that need a reset, and an escalation beside a latched fault."""
    bench.cycle(Fault.A3)
    bench.cycles(CAUSE_CYCLES)
    bench.cycle(Fault.P4)
    both = bench.register.blocking
    bench.cycles(SECOND + 1, Fault.S5)

    assert both == mask([Fault.A3, Fault.P4])
    assert bench.register.blocking == mask([Fault.A3, Fault.P4, Fault.S5])


def test_adjacent_faults_of_one_source_hold_once(bench: RegisterBench) -> None:
    """Whatever their order in the table is."""
    bench.cycle(Fault.S2)

    assert bench.cycle(Fault.S2, Fault.S1) is Reaction.NONE
    assert bench.present == [Fault.S1, Fault.S2]


@pytest.mark.parametrize(
    ("cycles", "reaction"), [(CAUSE_CYCLES - 1, Reaction.NONE), (CAUSE_CYCLES, Reaction.HOLD)]
)
def test_consequence_is_found_at_most_ten_cycles_before_its_cause(
    bench: RegisterBench, cycles: int, reaction: Reaction
) -> None:
    """After that the other fault holds on its own account, which is a second HOLD."""
    bench.cycle(Fault.S5)
    bench.cycles(cycles, Fault.S5)

    assert bench.cycle(Fault.S5, Fault.A3) is reaction


def test_fault_of_the_process_holds_soon_after_one_of_a_sensor(bench: RegisterBench) -> None:
    """A driver that fails is no cause of the fault that was found before."""
    assert bench.cycles(2, Fault.S5)[0] is Reaction.HOLD

    assert bench.cycle(Fault.S5, Fault.P3) is Reaction.HOLD


def test_fault_of_the_process_is_no_consequence_of_a_later_one(bench: RegisterBench) -> None:
    """A sensor that is lost just after a failed control law holds again."""
    bench.cycle(Fault.P4)

    assert bench.cycle(Fault.P4, Fault.S5) is Reaction.HOLD


def test_worst_fault_is_named_with_what_ends_it(bench: RegisterBench) -> None:
    """Word by word, for an engineer and for an operator."""
    bench.cycle(Fault.A12)
    bench.cycles(CAUSE_CYCLES)
    bench.cycle(Fault.P4)
    bench.cycles(SECOND)
    worst = bench.register.no_entry
    bench.register.reset(engineer=True)
    bench.cycle(Fault.A3)
    bench.cycles(GOOD_CYCLES)

    assert worst == (
        "A12 was found: read-back voltage outside the range; check the amplifier before you switch "
        "anything on again; `piezod reset --engineer` ends it once it has been gone for a second"
    )
    assert bench.register.no_entry == (
        "A3 was found: read-back voltage differs from the written one; check load and calibration "
        "of the amplifier, and that its knob is not turned; `piezod reset` ends it once it has "
        "been gone for a second"
    )
