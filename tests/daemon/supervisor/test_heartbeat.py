"""The beat by which the loop sees its supervisor."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.daemon.loop import accept
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.supervisor.heartbeat import BUSY_S, Heartbeat
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
def heartbeat(loops: list[LoopConnection]) -> Iterator[Heartbeat]:
    """Return a heartbeat for the first loop."""
    heartbeat = Heartbeat(loops[0])
    heartbeat.start()
    yield heartbeat
    heartbeat.stop()


def beat_ns(loop: LoopConnection) -> int:
    """Return the newest beat."""
    return loop.shared.words[Word.SUPERVISOR_BEAT_NS]


@pytest.mark.usefixtures("heartbeat")
def test_it_beats_beside_an_event_loop_that_is_busy(loops: list[LoopConnection]) -> None:
    """The beat continues without further ticks."""
    first_ns = eventually(lambda: beat_ns(loops[0]))

    eventually(lambda: beat_ns(loops[0]) > first_ns)


@pytest.mark.fault("H1")
def test_it_stops_if_the_event_loop_hangs(loops: list[LoopConnection]) -> None:
    """The beat stops 3 s after the last tick, and continues with the next one."""
    heartbeat, busy_ns = Heartbeat(loops[0]), s_to_ns(BUSY_S)

    heartbeat.tick(1000)
    heartbeat.beat(1000 + busy_ns - 1)
    heartbeat.beat(1000 + busy_ns)
    last_ns = beat_ns(loops[0])
    heartbeat.tick(2000 + busy_ns)
    heartbeat.beat(2001 + busy_ns)

    assert last_ns == 1000 + busy_ns - 1
    assert beat_ns(loops[0]) == 2001 + busy_ns


def test_it_beats_for_the_loop_that_runs(loops: list[LoopConnection], heartbeat: Heartbeat) -> None:
    """After a reload it beats for the new loop."""
    heartbeat.beat_for(loops[1])

    eventually(lambda: beat_ns(loops[1]))
