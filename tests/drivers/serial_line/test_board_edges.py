"""Plays on a player board that wait for edges: the compiled firmware, with a camera at its pin."""

from typing import Final

import numpy as np
import pytest

from piezod.devices.player import EdgeWaits, PlayState, Table
from piezod.errors import DeviceError
from piezod_drivers.serial_line.piezo_board.emulation.simavr import CLOCK_HZ
from tests.drivers.serial_line.board_play_bench import BoardBench, needs_board, play_bench
from tests.drivers.serial_line.scripted_line import MS

pytestmark = needs_board
PLANES: Final = 50
HOLD, MOVE, US = 18, 18, 1000
POINTS: Final = HOLD + MOVE
INTERVAL_NS: Final = 250 * US
FRAME: Final = CLOCK_HZ // 100


def stack(planes: int = PLANES, within_ns: int = 500 * MS) -> Table:
    """Return planes from 1 V to 2 V; an edge ends each. The board plays 9 ms between two."""
    level = np.linspace(1.0, 2.0, planes)
    after = np.append(level[1:], level[-1])
    blend = np.clip((np.arange(POINTS) - HOLD + 1) / MOVE, 0.0, 1.0)
    sweeps = level[:, None] + (after - level)[:, None] * blend
    period = np.append(sweeps.ravel(), np.full(2 * POINTS, level[-1]))[:, None]
    return Table(
        INTERVAL_NS, period[:0], period, 1, edges=EdgeWaits(HOLD, POINTS, planes, within_ns)
    )


def started(table: Table) -> BoardBench:
    """Return a board that plays a table from its first voltage."""
    bench = play_bench()
    assert bench.device.write([1.0], bench.time.t_ns)
    bench.start(table)
    return bench


def camera(bench: BoardBench, after: int, edges: int) -> None:
    """Let a camera give edges, a hundred a second, the first one some cycles later."""
    bench.board.processor.camera(bench.board.processor.cycle + after, FRAME, edges)


def test_a_camera_steps_through_the_planes() -> None:
    """Fifty, a hundred pulses a second: none lost, none late; each has its time."""
    bench = started(stack())
    camera(bench, FRAME, PLANES)
    ended = bench.progress_to_end()
    record = bench.device.recording()
    seen = bench.board.processor.seen
    apart_ns = np.diff([edge.t_ns for edge in record.edges])

    assert ended.state is PlayState.ENDED, ended
    assert [edge.used for edge in record.edges] == [True] * PLANES
    assert apart_ns == pytest.approx(10 * MS, abs=20 * US)
    assert len(record.positions) == (PLANES + 2) * POINTS
    # Behind an edge the first point comes at once, then one in each interval.
    assert seen.shortest >= CLOCK_HZ * INTERVAL_NS // 10**9 - 8
    codes = bench.driven_codes[1:]
    assert np.diff(codes).max() <= 65_535 / 5.0 / (PLANES - 1) / MOVE + 1.5
    assert codes[-1] == pytest.approx(2.0 / 5.0 * 65_535, abs=1)


def test_edges_on_the_way_move_nothing_and_are_told() -> None:
    """Twice as many pulses as the planes allow: every other one is counted as too early."""
    bench = started(stack(planes=10))
    bench.board.processor.camera(bench.board.processor.cycle + FRAME, FRAME // 2, 22)
    assert bench.progress_to_end().state is PlayState.ENDED
    edges = bench.device.recording().edges

    assert sum(edge.used for edge in edges) == 10
    assert [edge.used for edge in edges[:4]] == [True, False, True, False]
    assert not any(edge.used for edge in edges[20:])
    assert len(edges) == 22


def test_without_an_edge_the_play_ends_where_it_is() -> None:
    """After its limit, with the record so far; the output holds, and a setpoint is taken."""
    bench = started(stack())
    camera(bench, FRAME, 7)
    ended = bench.progress_to_end()
    record = bench.device.recording()

    assert ended.state is PlayState.ENDED
    assert [edge.used for edge in record.edges] == [True] * 7
    assert len(record.positions) == 7 * POINTS + HOLD
    plane_7_v = 1.0 + 7 / (PLANES - 1)
    assert bench.device.read_back(bench.time.t_ns)[0] == pytest.approx(plane_7_v, abs=1e-3)
    assert bench.device.write([plane_7_v], bench.time.t_ns)


def test_an_edge_starts_a_play() -> None:
    """Until then the output stays."""
    table = stack(planes=10)._replace(edges=EdgeWaits(0, 1, 1, 1000 * MS))
    bench = started(table)
    bench.wait(300 * MS)
    assert bench.device.progress(bench.time.t_ns).state is PlayState.PLAYING
    assert bench.driven_codes[-1] == pytest.approx(1.0 / 5.0 * 65_535, abs=1)
    bench.board.processor.edge()
    assert bench.progress_to_end().state is PlayState.ENDED
    (edge,) = bench.device.recording().edges

    assert edge.used
    assert edge.t_ns >= 200 * MS


def test_what_does_not_fit_is_refused() -> None:
    """Table, record and edges share the memory."""
    bench = play_bench()
    with pytest.raises(DeviceError, match="longer interval"):
        bench.device.load(stack(planes=110))


def test_a_point_follows_its_edge_at_once() -> None:
    """Within 40 µs, and not an interval later."""
    bench = started(stack(planes=5))
    processor = bench.board.processor
    processor.run(processor.cycle + FRAME)
    before = processor.seen.sets
    processor.edge()
    processor.run(processor.cycle + CLOCK_HZ * 40 // 10**6)

    assert processor.seen.sets == before + 1


def test_edges_make_no_point_late() -> None:
    """At the shortest interval, with edges at any place between two points."""
    table = stack(planes=1)._replace(interval_ns=50 * US)
    period = np.tile(table.period, (20, 1))
    bench = started(table._replace(period=period, edges=EdgeWaits(0, 1, 1, 1000 * MS)))
    bench.board.processor.forget()
    bench.board.processor.camera(bench.board.processor.cycle + FRAME, 1_237, 800)
    assert bench.progress_to_end().state is PlayState.ENDED
    seen = bench.board.processor.seen

    assert seen.longest - seen.shortest <= 16
