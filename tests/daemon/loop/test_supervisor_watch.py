"""When the loop takes its supervisor for lost."""

import os
from pathlib import Path

import pytest

from piezod.daemon.loop.loop import SUPERVISOR_LATE_NS, SUPERVISOR_LOST_NS, SupervisorWatch
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

PERIOD_NS = 1_000_000
NO_PROCESS = 0
"""Id that no supervisor has."""


@pytest.fixture
def shared(tmp_path: Path) -> SharedMap:
    """Return a shared memory whose supervisor is the parent of this process."""
    shared = create(tmp_path / "loop.map", Layout(("x",), 2000, PERIOD_NS))
    shared.words[Word.SUPERVISOR_PID] = os.getppid()
    return shared


def test_supervisor_that_beats_late_is_not_lost(shared: SharedMap) -> None:
    """Beats that are 3 s apart are no fault while its process lives; a longer silence is, once."""
    watch = SupervisorWatch(shared)
    found = []
    for k in range(3):
        shared.words[Word.SUPERVISOR_BEAT_NS] = 1 + k
        found += [watch.lost(k * SUPERVISOR_LATE_NS + t_ns, 0) for t_ns in (0, SUPERVISOR_LATE_NS)]
    late = [watch.lost(3 * SUPERVISOR_LATE_NS + t_ns, 0) for t_ns in (PERIOD_NS, NS_PER_S)]

    assert found == [0] * 6
    assert late == [SUPERVISOR_LATE_NS, 0]


def test_supervisor_that_ends_during_its_silence_is_lost_at_once(shared: SharedMap) -> None:
    """A silence of 2 s is a loss from the cycle on in which the loop has another parent."""
    watch = SupervisorWatch(shared)
    shared.words[Word.SUPERVISOR_BEAT_NS] = 1
    living = [watch.lost(t_ns, 0) for t_ns in (0, 2 * NS_PER_S)]
    shared.words[Word.SUPERVISOR_PID] = NO_PROCESS
    ended = watch.lost(2 * NS_PER_S + PERIOD_NS, 0)

    assert living == [0, 0]
    assert ended == SUPERVISOR_LOST_NS


@pytest.mark.parametrize("supervisor", [NO_PROCESS, os.getppid()], ids=["ended", "lives"])
def test_pause_of_the_machine_is_not_taken_for_a_lost_supervisor(
    shared: SharedMap, supervisor: int
) -> None:
    """After a pause of the loop the supervisor has its full time to beat again."""
    shared.words[Word.SUPERVISOR_PID] = supervisor
    watch = SupervisorWatch(shared)
    shared.words[Word.SUPERVISOR_BEAT_NS] = 1
    watch.lost(0, 0)
    skipped = 5 * SUPERVISOR_LATE_NS // PERIOD_NS
    end_ns = (skipped + 1) * PERIOD_NS

    assert watch.lost(end_ns, skipped) == 0
    assert watch.lost(end_ns + SUPERVISOR_LOST_NS - PERIOD_NS, 0) == 0
