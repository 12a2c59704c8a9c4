"""The beat by which the loop sees its supervisor."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.daemon.loop import accept
from piezod.daemon.supervisor.connection import LoopConnection
from piezod.daemon.supervisor.heart import BUSY_S, Heart
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from piezod.telemetry.words import Word
from piezod.units import s_to_ns
from tests.daemon.waiting import eventually


@pytest.fixture
def loops(tmp_path: Path, rig_file: Path) -> list[LoopConnection]:
    """Return two loops of one stage."""
    config = accept.load(rig_file)
    maps = [create(tmp_path / name, Layout.of(config)) for name in "ab"]
    return [LoopConnection(config, shared) for shared in maps]


@pytest.fixture
def heart(loops: list[LoopConnection]) -> Iterator[Heart]:
    """Return a heart that beats for the first loop."""
    heart = Heart(loops[0])
    heart.start()
    yield heart
    heart.stop()


def beat_ns(loop: LoopConnection) -> int:
    """Return the newest beat."""
    return loop.shared.words[Word.SUPERVISOR_BEAT_NS]


@pytest.mark.usefixtures("heart")
def test_it_beats_beside_an_event_loop_that_is_busy(loops: list[LoopConnection]) -> None:
    """Without a further tick."""
    first_ns = eventually(lambda: beat_ns(loops[0]))

    eventually(lambda: beat_ns(loops[0]) > first_ns)


@pytest.mark.fault("H1")
def test_it_stops_where_the_event_loop_hangs(loops: list[LoopConnection]) -> None:
    """A supervisor that answers nobody is as good as gone; when it goes on, so does its heart."""
    heart, busy_ns = Heart(loops[0]), s_to_ns(BUSY_S)

    heart.tick(1000)
    heart.beat(1000 + busy_ns - 1)
    heart.beat(1000 + busy_ns)
    last_ns = beat_ns(loops[0])
    heart.tick(2000 + busy_ns)
    heart.beat(2001 + busy_ns)

    assert last_ns == 1000 + busy_ns - 1
    assert beat_ns(loops[0]) == 2001 + busy_ns


def test_it_beats_for_the_loop_that_runs(loops: list[LoopConnection], heart: Heart) -> None:
    """A reload exchanges that."""
    heart.beat_for(loops[1])

    eventually(lambda: beat_ns(loops[1]))
