"""Whether the loop runs."""

from pathlib import Path

import pytest

from piezod.daemon.supervisor.health import LoopHealth
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

TENTH_NS = NS_PER_S // 10


def _shared(folder: Path, period_ns: int) -> SharedMap:
    return create(folder / "loop.map", Layout(("x",), 64, period_ns))


def test_only_new_cycles_count(tmp_path: Path) -> None:
    """A look finds the loop healthy where it has run a cycle since the last one."""
    shared = _shared(tmp_path, 1_000_000)
    health = LoopHealth(shared, 0)
    looks = []
    for look, cycles in enumerate((0, 0, 5, 5, 6)):
        shared.words[Word.HEALTHY_CYCLES] = cycles
        looks.append(health.look(look * TENTH_NS))

    assert looks == [False, False, True, False, True]


def test_slow_loop_is_healthy_between_its_cycles(tmp_path: Path) -> None:
    """With one cycle a second most looks find none, and the watchdog is fed all the same."""
    shared = _shared(tmp_path, NS_PER_S)
    health = LoopHealth(shared, 0)
    shared.words[Word.HEALTHY_CYCLES] = 1

    looks = [health.look(look * TENTH_NS) for look in range(25)]

    assert looks == [True] * 21 + [False] * 4


@pytest.mark.fault("L3")
def test_loop_hangs_after_two_seconds_or_five_periods(tmp_path: Path) -> None:
    """A loop that has run counts as hung, one that still starts does not."""
    shared = _shared(tmp_path, NS_PER_S)
    health = LoopHealth(shared, 0)
    starting = health.hung(100 * NS_PER_S)
    shared.words[Word.HEALTHY_CYCLES] = 1
    health.look(0)

    assert not starting
    assert not health.hung(5 * NS_PER_S)
    assert health.hung(5 * NS_PER_S + 1)
    assert health.age_s(NS_PER_S) == 1


def test_pause_of_the_supervisor_is_none_of_the_loop(tmp_path: Path) -> None:
    """A machine that stood still for a minute does not make the loop hang."""
    shared = _shared(tmp_path, 1_000_000)
    health = LoopHealth(shared, 0)
    shared.words[Word.HEALTHY_CYCLES] = 1
    health.look(0)

    health.look(60 * NS_PER_S)

    assert not health.hung(62 * NS_PER_S)
    assert health.hung(62 * NS_PER_S + 1)
