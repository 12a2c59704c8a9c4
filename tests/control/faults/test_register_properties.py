"""Tests of properties that the fault register has for any faults."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from piezod.config.faults import Fault
from piezod.control.faults.table import FAULTS, INDEX, Latch
from tests.control.register_bench import SECOND, RegisterBench

FOUND = st.lists(st.sets(st.sampled_from([rule.id for rule in FAULTS]), max_size=4), max_size=60)


@given(found=FOUND)
def test_suppression_never_weakens_the_reaction(found: Sequence[set[Fault]]) -> None:
    """For every detected fault, a fault with at least as severe a reaction is present."""
    bench = RegisterBench()
    for faults in found:
        bench.cycle(*faults)
        present = max((FAULTS[INDEX[fault]].reaction for fault in bench.present), default=0)

        assert all(FAULTS[INDEX[fault]].reaction <= present for fault in faults)


@given(found=FOUND, engineer=st.booleans(), wait=st.integers(0, 2 * SECOND))
def test_reset_after_a_second_without_faults_ends_all(
    found: Sequence[set[Fault]], engineer: bool, wait: int
) -> None:
    """Only faults that need an engineer are left; before that, no present fault is dropped."""
    bench = RegisterBench()
    for faults in found:
        bench.cycle(*faults)
    bench.cycles(wait)
    present = bench.register.present & bench.register.latched
    bench.register.reset(engineer)
    left = {FAULTS[INDEX[fault]].latch for fault in bench.latched}

    assert bench.register.latched & present == present
    if wait >= SECOND:
        assert left <= (set() if engineer else {Latch.ENGINEER})


@given(found=FOUND)
def test_each_fault_that_ends_has_appeared(found: Sequence[set[Fault]]) -> None:
    """No fault ends twice, and a fault that is over is in no mask."""
    bench = RegisterBench()
    for faults in found:
        bench.cycle(*faults)
    bench.cycles(SECOND)
    bench.register.reset(engineer=True)
    bench.cycle()
    begun = {fault for fault, appeared in bench.changes if appeared}
    last = dict(bench.changes)

    assert set(last) == begun
    assert not any(last.values())
    assert bench.register.present == bench.register.latched == 0
