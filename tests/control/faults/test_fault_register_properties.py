"""Whatever faults come and go: what the register never does."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from piezod.config.faults import Fault
from piezod.control.faults.table import FAULTS, INDEX, Latch
from tests.control.registered import SECOND, Stage

FOUND = st.lists(st.sets(st.sampled_from([rule.id for rule in FAULTS]), max_size=4), max_size=60)


@given(found=FOUND)
def test_suppression_never_weakens_the_reaction(found: Sequence[set[Fault]]) -> None:
    """Whatever is found: something at least as strict is present, and was reacted to."""
    stage = Stage()
    for faults in found:
        stage.cycle(*faults)
        present = max((FAULTS[INDEX[fault]].reaction for fault in stage.present), default=0)

        assert all(FAULTS[INDEX[fault]].reaction <= present for fault in faults)


@given(found=FOUND, engineer=st.booleans(), wait=st.integers(0, 2 * SECOND))
def test_after_a_second_without_faults_a_reset_ends_all(
    found: Sequence[set[Fault]], engineer: bool, wait: int
) -> None:
    """What is then left needs an engineer; before, nothing present is dropped."""
    stage = Stage()
    for faults in found:
        stage.cycle(*faults)
    stage.cycles(wait)
    present = stage.register.present & stage.register.latched
    stage.register.reset(engineer)
    left = {FAULTS[INDEX[fault]].latch for fault in stage.latched}

    assert stage.register.latched & present == present
    if wait >= SECOND:
        assert left <= (set() if engineer else {Latch.L3})


@given(found=FOUND)
def test_each_fault_that_ends_has_begun(found: Sequence[set[Fault]]) -> None:
    """The log pairs up: nothing ends twice, and what is over is in no mask."""
    stage = Stage()
    for faults in found:
        stage.cycle(*faults)
    stage.cycles(SECOND)
    stage.register.reset(engineer=True)
    stage.cycle()
    begun = {fault for fault, appeared in stage.told if appeared}
    last = dict(stage.told)

    assert set(last) == begun
    assert not any(last.values())
    assert stage.register.present == stage.register.latched == 0
