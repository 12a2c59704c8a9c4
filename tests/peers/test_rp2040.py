"""The firmware of the player board for an RP2040, with our driver and the conformance script."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.player import EdgeWaits, PlayState, Table
from piezod.experiment.scan.edges import edge_notes
from piezod_drivers.serial_line.piezo_board import codec
from piezod_drivers.serial_line.piezo_board.driver import make_device
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from tests.drivers.serial_line.board_conformance import EmulatedPort, script
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime
from tests.drivers.serial_line.test_board_edges import HOLD, POINTS, stack
from tests.peers.rp2040 import Rp2040, image, missing

pytestmark = [
    pytest.mark.peers,
    pytest.mark.skipif(bool(missing()), reason=missing() or "nothing is missing"),
]
US: Final = 1000


class Bench:
    """A board, its driver, and their time."""

    def __init__(
        self, folder: Path, channels: int = 1, defines: str = "", **options: object
    ) -> None:
        self.time = TestTime()
        flashed = image(folder, f"-DPORT_CHANNELS={channels} -DPLAYER_SAFE=100 {defines}")
        self.board = Rp2040(flashed, self.time)
        known = {"port": "p", "timeout_ms": 100.0, "channels": channels, **options}
        wiring = Wiring.both(tuple("12"[:channels]))
        line = EmulatedLine(self.board, self.time)
        device = make_device(line, BoardOptions.model_validate(known), wiring)
        assert isinstance(device, PlayingBusDevice)
        self.device = device

    def activate(self) -> None:
        """Let the board drive its outputs."""
        self.device.open()
        self.device.activate(self.time.t_ns)

    def play(self, table: Table) -> None:
        """Load a table and start it."""
        self.device.load(table)
        self.device.arm()
        self.device.start(self.time.t_ns)

    def end(self) -> None:
        """Wait for the end of a play."""
        for _ in range(500):
            self.time.t_ns += 20 * MS
            self.board.due()
            found = self.device.progress(self.time.t_ns)
            if found.state is not PlayState.PLAYING:
                break
        assert found.state is PlayState.ENDED, found


@pytest.fixture
def benches() -> Iterator[list[Bench]]:
    """Collect the boards of a test, and end their processes."""
    made: list[Bench] = []
    yield made
    for each in made:
        each.board.close()


def table(rows: int, channels: int, interval_ns: int, cycles: int) -> Table:
    """Return a table of triangles between 1 and 4 V, another phase for each channel."""
    phase = np.arange(rows)[:, None] / rows + 0.25 * np.arange(channels)
    return Table(interval_ns, np.zeros((0, channels)), 1 + 6 * np.abs(phase % 1 - 0.5), cycles)


def test_firmware_conforms(tmp_path: Path, benches: list[Bench]) -> None:
    """Every check of the script for boards passes; the safe voltage came before anything else."""
    bench = Bench(tmp_path)
    benches.append(bench)
    assert (bench.board.seen["first_ns"], bench.board.seen["out"][0]) < (1_000_000, 101)
    assert script().failures(EmulatedPort(bench.board, bench.time)) == []
    assert (bench.board.seen["bad"], bench.board.seen["resets"]) == (0, 0)


@pytest.mark.parametrize(("channels", "interval_us"), [(1, 50), (1, 20), (2, 30)])
def test_points_come_in_time(
    channels: int, interval_us: int, tmp_path: Path, benches: list[Bench]
) -> None:
    """None is late, none is more than 0.5 µs off, and the record shows each point before."""
    bench = Bench(tmp_path, channels)
    benches.append(bench)
    bench.activate()
    assert bench.device.write([2.0] * channels, bench.time.t_ns)
    wave = table(100, channels, interval_us * US, 50)
    bench.play(wave)
    bench.end()
    seen = bench.board.seen
    assert (seen["points"], seen["lines"], seen["frames"], seen["bad"]) == (5000, 50, 1, 0)
    assert max(interval_us * US - seen["shortest_ns"], seen["longest_ns"] - interval_us * US) <= 500
    codes = np.rint(wave.period / 5.0 * 65_535)
    shown = (1000 + codes[:-1] // 2) / 65_535 * 5.0
    assert bench.device.recording().positions[1:100] == pytest.approx(shown, abs=1e-9)


@pytest.mark.parametrize(
    ("play_on", "edges", "points"), [("step edges", 3, 3), ("start edge", 1, 10)]
)
def test_edges_start_and_step(
    play_on: str, edges: int, points: int, tmp_path: Path, benches: list[Bench]
) -> None:
    """With `step edges` each edge at the trigger input is a point; with `start edge` one starts."""
    bench = Bench(tmp_path, play_on=play_on)
    benches.append(bench)
    bench.activate()
    bench.play(table(10, 1, 50 * US, 1))
    bench.board.run(10_000)
    assert bench.board.seen["points"] == 0
    bench.board.camera(*range(0, 2_000 * edges, 2_000))
    bench.board.run(2_000 * edges)
    assert bench.board.seen["points"] == points


def test_a_camera_steps_through_the_planes(tmp_path: Path, benches: list[Bench]) -> None:
    """Each pulse has its time; one that comes too early and one that is missing are told."""
    bench = Bench(tmp_path)
    benches.append(bench)
    bench.activate()
    bench.play(stack(planes=10))
    times_ms = [100, 110, 120, 123, 130, 140, 160, 170, 180, 190, 200]
    bench.board.camera(*(1_000 * at for at in times_ms))
    bench.end()
    record = bench.device.recording()
    assert [edge.used for edge in record.edges] == [at != 123 for at in times_ms]
    apart_ns = np.diff([edge.t_ns for edge in record.edges])
    assert apart_ns == pytest.approx(np.diff(times_ms) * MS, abs=20 * US)
    assert len(list(edge_notes(record.edges, 10))) == 2
    assert len(record.positions) == 12 * POINTS
    assert bench.board.seen["out"][0] == pytest.approx(2.0 / 5.0 * 65_535, abs=1)


def test_without_an_edge_the_play_ends_where_it_is(tmp_path: Path, benches: list[Bench]) -> None:
    """After its limit, with the record so far."""
    bench = Bench(tmp_path)
    benches.append(bench)
    bench.activate()
    bench.play(stack(planes=10))
    bench.board.camera(100_000, 110_000)
    bench.end()
    record = bench.device.recording()
    assert [edge.used for edge in record.edges] == [True] * 2
    assert len(record.positions) == 2 * POINTS + HOLD


def test_a_point_follows_its_edge_at_once(tmp_path: Path, benches: list[Bench]) -> None:
    """Within 15 µs, and not an interval later."""
    bench = Bench(tmp_path)
    benches.append(bench)
    bench.activate()
    bench.play(stack(planes=5)._replace(edges=EdgeWaits(0, 1, 1, 1000 * MS)))
    bench.board.run(20_000)
    assert bench.board.seen["out"][0] == 100
    bench.board.run(15, edges_us=[0])
    assert bench.board.seen["out"][0] == pytest.approx(1.0 / 5.0 * 65_535, abs=1)


def test_edges_make_no_point_late(tmp_path: Path, benches: list[Bench]) -> None:
    """At the shortest interval, with edges at any place between two points."""
    bench = Bench(tmp_path)
    benches.append(bench)
    bench.activate()
    wave = table(400, 1, 20 * US, 1)
    bench.play(wave._replace(edges=EdgeWaits(0, 1, 1, 1000 * MS)))
    bench.board.camera(0, *(1_000 + 11.31 * np.arange(600)))
    bench.end()
    seen = bench.board.seen
    assert max(20 * US - seen["shortest_ns"], seen["longest_ns"] - 20 * US) <= 100
    assert [edge.used for edge in bench.device.recording().edges] == [True] + 16 * [False]


def test_silent_host_leaves_the_safe_voltage(tmp_path: Path, benches: list[Bench]) -> None:
    """A play ends, and the output goes to the safe code in small steps; nothing was reset."""
    bench = Bench(tmp_path)
    benches.append(bench)
    bench.activate()
    bench.play(table(100, 1, 50 * US, 100_000))
    bench.board.run(1_500_000)
    assert (bench.board.seen["out"][0], bench.board.seen["resets"]) == (100, 0)


def test_program_without_time_is_reset(tmp_path: Path, benches: list[Bench]) -> None:
    """Where points leave the main loop no time, the watchdog resets the processor."""
    bench = Bench(tmp_path, defines="-DPORT_SHORTEST=40")
    benches.append(bench)
    data = codec.data_bytes([30_000, 30_001])
    prepare = b"P 0 2 1000000 40 0 %04X\nG\n" % codec.crc_of(data)
    for part in (b"ON\nT 0 2\n", codec.with_crc(data), prepare):
        bench.board.run(10_000, part)
    bench.board.run(300_000)
    assert (bench.board.seen["frames"], bench.board.seen["resets"]) == (1, 1)
