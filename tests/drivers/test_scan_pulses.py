"""Scans on emulated controllers: their points, their records, and their pulses, counted there."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pytest

from piezod.devices.interface import Device, Wiring
from piezod.devices.played_axis import AxisTable, PlayedAxis, load_together
from piezod.devices.played_scan import PlayedScan
from piezod.devices.player import Comparison, EdgeWaits, PlayState
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import ChannelPair
from piezod.errors import DeviceError
from piezod_drivers.modbus.emulation.labjack import LabJackServer
from tests.drivers.modbus.play_bench import play_bench as labjack_bench
from tests.drivers.play_bench import PlayBench
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.board_play_bench import play_bench as board_bench
from tests.drivers.serial_line.pi_play_bench import play_bench as pi_bench

PIXELS: Final = 16
PER_PIXEL: Final = 4
TURN: Final = 16
PIXEL, LINE, FRAME = 1, 2, 4


@dataclass(frozen=True)
class Case:
    """A controller with two axes."""

    open: Callable[[], PlayBench]  #: Returns it, active.
    channels: tuple[tuple[str, str], tuple[str, str]]  #: Input and output of both axes.
    top: float  #: A voltage in the middle of its range.

    def axes(self) -> Mapping[str, ChannelPair]:
        """Return the channels of axes x and y."""
        return {
            name: ChannelPair("device", "device", input=input, output=output)
            for name, (input, output) in zip("xy", self.channels, strict=True)
        }


T7: Final = Case(
    lambda: labjack_bench(wiring=Wiring(("AIN0", "AIN1"), ("DAC0", "DAC1"))),
    (("AIN0", "DAC0"), ("AIN1", "DAC1")),
    3.0,
)
PI: Final = Case(
    lambda: pi_bench(2, trigger_outputs=3, wave_end="holds"), (("1", "1"), ("2", "2")), 60.0
)
BOARD: Final = Case(
    lambda: board_bench(wiring=Wiring.both(("1", "2"))), (("1", "1"), ("2", "2")), 2.0
)
CASES: Final = pytest.mark.parametrize(
    "case", [T7, PI, pytest.param(BOARD, marks=needs_board)], ids=["t7", "pi", "board"]
)


def snake(top: float, lines: int, interval_ns: int = 100_000, pixels: int = PIXELS) -> ScanTable:
    """Return a snake: x there and back, y up by a step in each turn, with all pulses."""
    active = pixels * PER_PIXEL
    m = active + TURN
    ramp = np.minimum(np.arange(m), active) / active * top
    line = np.concatenate((ramp, ramp[::-1])) - 0.5 * top
    mask = np.zeros(m, np.uint8)
    mask[:active][np.arange(active) % PER_PIXEL < PER_PIXEL // 2] |= PIXEL
    mask[: PER_PIXEL // 2] |= LINE
    blend = np.clip((np.arange(m) - active + 1) / TURN, 0.0, 1.0)
    zero = np.zeros(2 * m)
    y = np.linspace(0.1, 0.5, lines) * top
    lead_in = np.linspace(0.0, 1.0, 50)[:, None] * np.array([0.0, y[0]])
    return ScanTable(
        axes=("x", "y"),
        interval_ns=interval_ns,
        lead_in_v=lead_in,
        line_v=np.stack((line, zero), axis=1),
        offset_v=np.stack((np.full(lines, 0.5 * top), y), axis=1),
        scale=np.ones((lines, 2)),
        blend=np.stack((blend, blend), axis=1),
        pulses=mask,
        framed=FRAME,
        frame_points=PER_PIXEL // 2,
        pause=active + TURN // 2,
    )


def play(bench: PlayBench, scan: PlayedScan, table: ScanTable) -> np.ndarray:
    """Play all blocks of a scan; return the recorded positions, shape (rows, 2)."""
    assert not scan.misfit(table)
    found = []
    for block in scan.blocks(table):
        scan.load(table, block, scan.columns(table, block), bench.time.t_ns)
        scan.player.arm()
        scan.player.start(bench.time.t_ns)
        assert bench.progress_to_end().state is PlayState.ENDED
        if block.is_before:
            continue
        lead_in = len(table.lead_in_v) if block.first == 0 else 0
        found.append(scan.recording(block, lead_in).position_um)
    return np.concatenate(found)


def opened(case: Case) -> tuple[PlayBench, PlayedScan]:
    """Return a controller, and its axes that scan."""
    bench = case.open()
    return bench, scan_of({"device": bench.device}, case.axes())


def scan_of(devices: Mapping[str, Device], axes: Mapping[str, ChannelPair]) -> PlayedScan:
    """Return the axes of a stage that scan together."""
    return PlayedScan({name: PlayedAxis(name, devices, axes) for name in axes}, axes)


def pulses_of(bench: PlayBench) -> list[int]:
    """Return what the emulated controller has counted, on its first three lines."""
    return list(bench.emulator.pulses[:3])  # type: ignore[attr-defined] # both have it


@CASES
def test_every_pulse_is_counted_by_the_device(case: Case) -> None:
    """One for each pixel, each sweep and the frame; each row of the table has a sample."""
    bench, scan = opened(case)
    table = snake(case.top, lines=6)
    position_um = play(bench, scan, table)

    assert pulses_of(bench) == [6 * PIXELS, 6, 1]
    assert position_um.shape == (table.n_rows, 2)
    assert np.isfinite(position_um).all()
    x = position_um[:, 0].reshape(6, -1)
    assert x[0, -1] > x[0, 0]
    assert x[1, -1] < x[1, 0]


@CASES
def test_a_scan_in_parts_has_the_same_pulses(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts begin where the fast axis stands still; the frame pulses once."""
    monkeypatch.setattr("piezod.devices.played_scan.MOST_BLOCK_POINTS", 200)
    bench, scan = opened(case)
    table = snake(case.top, lines=6)
    blocks = list(scan.blocks(table))
    position_um = play(bench, scan, table)

    assert len(blocks) > 2
    assert all((block.end - table.pause) % table.points == 0 for block in blocks[:-1])
    assert pulses_of(bench) == [6 * PIXELS, 6, 1]
    assert len(position_um) == table.n_rows


@CASES
@pytest.mark.parametrize("lead_in", [0, 20])
def test_each_period_has_its_pulses(case: Case, lead_in: int) -> None:
    """Also behind a lead-in, with which a PI controller holds all periods as one wave."""
    bench, scan = opened(case)
    period_v = 0.1 * case.top * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)))
    table = AxisTable(100_000, np.zeros(lead_in), period_v, cycles=3)
    pulses = np.where(np.arange(40) % 10 < 5, PIXEL, 0).astype(np.uint8)
    pulses[:5] |= LINE
    load_together(scan.axes, [table, table], pulses, bench.time.t_ns)
    scan.player.arm()
    scan.player.start(bench.time.t_ns)
    assert bench.progress_to_end().state is PlayState.ENDED

    assert pulses_of(bench) == [12, 3, 0]


def test_a_part_begins_with_the_motion_before_it() -> None:
    """Its run-up is the last period of the line, at the level that the slow axis has there."""
    table = snake(T7.top, lines=6)
    first = 3 * table.points + table.pause
    run_up = table.run_up(first)
    n = 2 * table.points

    assert np.allclose(run_up[:, 0], table.rows(first - n, first)[:, 0])
    assert np.allclose(run_up[:, 1], table.rows(first, first + 1)[0, 1])
    assert table._replace(line_v=0.0 * table.line_v).run_up(first).size == 0


@pytest.mark.parametrize("case", [T7, PI], ids=["t7", "pi"])
def test_pulses_may_differ_from_sweep_to_sweep(case: Case) -> None:
    """Those at positions have other points forward and backward, at any distance."""
    bench, scan = opened(case)
    table = snake(case.top, lines=4)
    two = np.zeros(2 * table.points, np.uint8)
    two[[3, 10, 12, 40, table.points + 5, table.points + 30]] = PIXEL
    play(bench, scan, table._replace(pulses=two, framed=0))

    assert scan.capabilities.pulses_at[0] == "time"
    assert pulses_of(bench) == [2 * 6, 0, 0]


@pytest.mark.parametrize("step_um", [0.5, -0.5], ids=["up", "down"])
def test_a_pi_controller_pulses_by_its_own_reading(step_um: float) -> None:
    """Once for each step in each sweep that way, and not in the lead-in."""
    bench, scan = opened(PI)
    table = snake(PI.top, lines=6)
    ends_um = (2.1, 9.8) if step_um > 0.0 else (9.8, 2.1)
    swing = Comparison(3, 0, ends_um[0], ends_um[1], step_um)
    x = play(bench, scan, table._replace(compared=swing))[:, 0].reshape(6, -1)

    assert x.min() < min(ends_um)
    assert x.max() > max(ends_um)
    assert pulses_of(bench) == [6 * PIXELS, 6, 3 * len(np.arange(2.1, 9.8, 0.5))]


@CASES
def test_a_device_that_does_not_compare_refuses(case: Case) -> None:
    """A LabJack and a board."""
    _, scan = opened(case)
    table = snake(case.top, lines=4)._replace(compared=Comparison(3, 0, 1.0, 2.0, 0.1))

    assert (scan.misfit(table) == "") == (case is PI)
    assert ("time" in scan.capabilities.pulses_at) == (case is not BOARD)


@pytest.mark.stress
@pytest.mark.timeout(1800)
@CASES
def test_all_pulses_of_a_large_picture_are_counted(case: Case) -> None:
    """256 x 256 pixels at 10 lines a second: 65,536 pulses of pixels, 256 of lines."""
    bench, scan = opened(case)
    table = snake(case.top, lines=256, pixels=256, interval_ns=100_000 if case is PI else 80_000)
    play(bench, scan, table)

    assert pulses_of(bench) == [65_536, 256, 1]


def test_lines_are_low_after_a_stop() -> None:
    """The stop of a LabJack also sets its lines; a shutter does not stay open."""
    bench, scan = opened(T7)
    table = snake(T7.top, lines=6)
    (block,) = scan.blocks(table)
    scan.load(table, block, scan.columns(table, block), bench.time.t_ns)
    scan.player.arm()
    scan.player.start(bench.time.t_ns)
    bench.wait(50 * table.interval_ns + PER_PIXEL // 4 * table.interval_ns)
    scan.player.progress(bench.time.t_ns)
    server = bench.emulator
    assert isinstance(server, LabJackServer)
    assert server.lines.state
    scan.player.abort(bench.time.t_ns)

    assert not server.lines.state


@CASES
def test_what_does_not_fit_is_refused_before_anything_is_sent(case: Case) -> None:
    """An interval, a line of pulses and a sweep that the device does not have."""
    _, scan = opened(case)
    table = snake(case.top, lines=4)
    high = table._replace(pulses=table.pulses | np.uint8(1 << 7))
    expected = "" if case is T7 else "pulses"
    edges = EdgeWaits(0, 1, 1, 10**9)

    assert case is BOARD or "not wait for edges" in scan.misfit(table._replace(edges=edges))
    assert "interval" in scan.misfit(table._replace(interval_ns=1_001))
    assert expected in scan.misfit(high)
    assert "longer interval" in scan.misfit(snake(case.top, lines=1, pixels=100_000))


def test_axes_of_two_devices_have_no_common_clock() -> None:
    """Such a scan is refused with the names of both."""
    bench = T7.open()
    axes = {
        "x": ChannelPair("a", "a", input="AIN0", output="DAC0"),
        "y": ChannelPair("b", "b", input="AIN1", output="DAC1"),
    }
    with pytest.raises(DeviceError, match="no common clock"):
        scan_of({"a": bench.device, "b": bench.device}, axes)


def test_a_device_without_lines_refuses_pulses() -> None:
    """A PI controller whose options name no outputs."""
    bench = pi_bench(2)
    scan = scan_of({"device": bench.device}, PI.axes())

    assert "options of its driver" in scan.misfit(snake(60.0, lines=2))


def test_a_device_must_hold_its_last_voltages() -> None:
    """A scan does not end at rest, and a part of one neither."""
    bench = pi_bench(2, trigger_outputs=3)
    scan = scan_of({"device": bench.device}, PI.axes())

    assert "wave_end" in scan.misfit(snake(60.0, lines=2))
