"""Health of the loop, by its beat."""

from pathlib import Path

import pytest

from piezod.daemon.stage.connection import LoopHealth
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

TENTH_NS = NS_PER_S // 10


def _shared(folder: Path, period_ns: int) -> SharedMap:
    return create(folder / "loop.map", Layout(("x",), 64, period_ns))


def test_only_new_cycles_count(tmp_path: Path) -> None:
    """An update finds the loop healthy if it ran a cycle since the last update."""
    shared = _shared(tmp_path, 1_000_000)
    health = LoopHealth(shared, 0)
    healthy = []
    for step, cycles in enumerate((0, 0, 5, 5, 6)):
        shared.words[Word.LOOP_BEAT_NS] = cycles
        healthy.append(health.update(step * TENTH_NS))

    assert healthy == [False, False, True, False, True]


def test_slow_loop_is_healthy_between_its_cycles(tmp_path: Path) -> None:
    """At one cycle a second, updates without a new cycle still find the loop healthy."""
    shared = _shared(tmp_path, NS_PER_S)
    health = LoopHealth(shared, 0)
    shared.words[Word.LOOP_BEAT_NS] = 1

    healthy = [health.update(step * TENTH_NS) for step in range(25)]

    assert healthy == [True] * 21 + [False] * 4


@pytest.mark.fault("L3")
def test_loop_hangs_after_two_seconds_or_five_periods(tmp_path: Path) -> None:
    """A loop that ran can hang; one that starts cannot."""
    shared = _shared(tmp_path, NS_PER_S)
    health = LoopHealth(shared, 0)
    starting = health.hung(100 * NS_PER_S)
    shared.words[Word.LOOP_BEAT_NS] = 1
    health.update(0)

    assert not starting
    assert not health.hung(5 * NS_PER_S)
    assert health.hung(5 * NS_PER_S + 1)
    assert health.age_s(NS_PER_S) == 1


def test_pause_of_the_supervisor_is_none_of_the_loop(tmp_path: Path) -> None:
    """A pause of the whole machine does not count for the loop."""
    shared = _shared(tmp_path, 1_000_000)
    health = LoopHealth(shared, 0)
    shared.words[Word.LOOP_BEAT_NS] = 1
    health.update(0)

    health.update(60 * NS_PER_S)

    assert not health.hung(62 * NS_PER_S)
    assert health.hung(62 * NS_PER_S + 1)
