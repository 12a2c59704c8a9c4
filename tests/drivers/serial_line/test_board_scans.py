"""A raster is learned and played through the compiled firmware, in virtual time."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from piezod.config.channels import LineCalibration
from piezod.config.scan import AnyScan, RasterScan, StackScan
from piezod.control.table_guard import TableGuard
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Identity, Wiring
from piezod.devices.outputs import CalibratedOutput
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis, load_together
from piezod.devices.played_scan import BlockRecord, PlayedScan
from piezod.devices.player import PlayState, SeenEdge
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import ChannelPair
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.stage import AtRest
from piezod.experiment.play.stored import Conditions
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.experiment.scan.learn import FrameReport
from piezod.experiment.scan.pixels import SweepSamples
from piezod.experiment.scan.plan import PlannedAxis, plan_scan
from piezod.experiment.scan.run import ScanSetting, Told, run_scan
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.piezo_board.driver import make_device
from piezod_drivers.serial_line.piezo_board.emulation.simavr import CLOCK_HZ
from piezod_drivers.serial_line.piezo_board.emulator import (
    LOWEST_UM,
    UM_PER_CODE,
    V_PER_CODE,
    BoardEmulator,
)
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.conftest import Figure
from tests.drivers.bus.test_learned import known_axis
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime
from tests.experiment.play.rig_axis import LIMITS, OPTIONS, RESPONSE, SENSOR_DELAY_S, model

pytestmark = needs_board
CODES: Final = 65_535
RAMP_S, REST_S = 0.1, 0.2
AXES: Final = ("x", "y")
CHANNELS: Final = ("1", "2")


class TrueBoard(BoardEmulator):
    """A board that keeps the true displacements at each point of a play."""

    def __init__(self, rig: SimulatedRig, time: TestTime) -> None:
        super().__init__(SharedRig(rig, time.now_ns), "")
        self._rig, self.true_um = rig, list[tuple[float, ...]]()

    def _sense(self, channel: int, cycle: int) -> int:
        code = super()._sense(channel, cycle)
        if self.processor.plays and channel == 1:  # sampled once for each point
            self.true_um.append(tuple(self._rig.true_position_um(self._ns_of(cycle))[::2]))
        return code


class BoardStage:
    """Implements `ScanStage` on an emulated board of two channels.

    Args:
        interval_ns: Time between two points of a table, in ns.
        scanned: Names of the axes that scan.
    """

    def __init__(self, interval_ns: int, scanned: tuple[str, ...] = AXES) -> None:
        self.time, self._interval_ns = TestTime(), interval_ns
        sensor = {"calibration": {"kind": "commissioned", "residual_pct": 0.01}}
        options = SimulatedOptions.model_validate({**OPTIONS, **sensor})
        rig = SimulatedRig(options, Wiring(("x", "x_v", "y", "y_v"), AXES), 1)
        rig.open()
        rig.activate(self.time.t_ns)
        self.board = TrueBoard(rig, self.time)
        line = EmulatedLine(self.board, self.time)
        options_ = BoardOptions(port="p", timeout_ms=100.0, channels=2)
        self.device = make_device(line, options_, Wiring.both(CHANNELS))
        self.identity: Identity = self.device.open()
        self.device.activate(self.time.t_ns)
        to_um = LineCalibration(gain=UM_PER_CODE * CODES / 5.0, offset=LOWEST_UM)
        to_v = LineCalibration(gain=V_PER_CODE * CODES / 5.0)
        self._to_v = CalibratedOutput(to_v)
        pairs = {
            name: ChannelPair("device", "device", channel, channel, to_um, to_v)
            for name, channel in zip(AXES, CHANNELS, strict=True)
        }
        self.played = {name: PlayedAxis(name, {"device": self.device}, pairs) for name in AXES}
        self.scanned = PlayedScan({name: self.played[name] for name in scanned}, pairs)
        able = self.scanned.capabilities
        self._guard = TableGuard(LIMITS, 0.0, able.at_end, able.cycles)
        self.axes: dict[str, ZeroedAxis] = {}
        self.pulses = np.zeros(3, int)  # of points, lines and frames
        self.edges: tuple[SeenEdge, ...] = ()

    def in_force_v(self, place: int) -> float:
        """Return the voltage of an axis."""
        return self._to_v.voltage(self.device.read_back(self.time.t_ns)[place])

    def rest(self) -> None:
        """Play a ramp of both axes to 0 V."""
        n = round(RAMP_S * NS_PER_S / self._interval_ns)
        down = 0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n)
        cycles = round(REST_S * NS_PER_S / self._interval_ns)
        tables = [
            AxisTable(self._interval_ns, self.in_force_v(i) * down, np.zeros(1), cycles)
            for i in range(len(AXES))
        ]
        load_together(tuple(self.played.values()), tables, None, self.time.t_ns)
        self.play_out()

    def check(self, tables: list[AxisTable]) -> None:
        """Let the guard see what each axis plays."""
        for axis, table in zip(self.scanned.axes, tables, strict=True):
            self._guard.check(table, self.in_force_v(axis.output))

    def play_out(self) -> None:
        """Play what is loaded."""
        player = self.scanned.player
        player.arm()
        self.board.true_um.clear()
        player.start(self.time.t_ns)
        while (progress := player.progress(self.time.t_ns)).state is PlayState.PLAYING:
            self.time.t_ns += 20 * MS
            self.board.due()
        assert progress.state is PlayState.ENDED, progress

    def scan(self, table: ScanTable) -> Iterator[SweepSamples]:
        """Play a scan; yield the samples of each sweep."""
        assert not self.scanned.misfit(table)
        zeros = np.array([self.axes[name].zero_um for name in table.axes])
        true_zeros = np.array([self.axes[name].true_zero_um for name in table.axes])
        places, nothing = [AXES.index(name) for name in table.axes], np.empty((0, len(table.axes)))
        rest, k, m = BlockRecord(nothing, nothing, np.empty((0, 0))), 0, table.points
        for block in self.scanned.blocks(table):
            columns = self.scanned.columns(table, block)
            self.check(columns)
            self.scanned.load(table, block, columns, self.time.t_ns)
            self.board.processor.forget()
            if table.edges is not None and not block.is_before:
                self.camera(table.edges.times)
            self.play_out()
            self.pulses += np.array(self.board.pulses)
            if block.is_before:
                continue
            record = self.scanned.recording(block, columns[0].lead_in_v.size)
            true_um = np.array(self.board.true_um[-len(record.position_um) :])[:, places]
            rest, self.edges = rest.joined(record._replace(true_um=true_um)), record.edges
            while k < table.sweeps and len(rest.position_um) >= m:
                sweep, rest = rest.split(m)
                yield SweepSamples(
                    k,
                    k * m * table.interval_ns,
                    sweep.position_um - zeros,
                    sweep.true_um - true_zeros,
                    sweep.detected,
                )
                k += 1

    def camera(self, edges: int) -> None:
        """Let a camera give edges, a hundred a second, from some time after the next start on."""
        processor = self.board.processor
        processor.camera(processor.cycle + CLOCK_HZ // 2, CLOCK_HZ // 100, edges)


class BoardAxis:
    """Implements `IdentifiedStage` for one axis of the board; the other one rests."""

    def __init__(self, stage: BoardStage, name: str) -> None:
        self._stage, self._place, self._played = stage, AXES.index(name), stage.played[name]
        self.identity = stage.identity

    def rest(self) -> AtRest:
        """Bring both axes to rest."""
        self._stage.rest()
        now_s = self._stage.time.t_ns / NS_PER_S
        return AtRest(now_s, self._stage.in_force_v(self._place))

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard accepts."""
        self._played.load(table, self._stage.time.t_ns)
        self._stage.play_out()
        record = self._played.recording()
        true_um = np.array(self._stage.board.true_um[-record.position_um.size :])
        return record._replace(true_um=true_um[:, self._place])


def run(
    stage: BoardStage, scan: AnyScan, file: Path, frames: list[FrameReport], notes: list[str]
) -> None:
    """Learn a scan on a board, and store it."""
    known, axes, names = known_axis(scan.interval_ns, 0.0), {}, [x.axis for x in scan.spans]
    for name in names:
        stage.axes[name] = ZeroedAxis(BoardAxis(stage, name), scan.interval_ns)
        conditions = Conditions(name, stage.identity, "", SENSOR_DELAY_S, 0.0)
        axes[name] = PlayingAxis(
            stage.axes[name], scan.interval_ns, model(), known.maker, None, conditions
        )
    planned = PlannedAxis((0.0, 28.0), RESPONSE.resonances[0].frequency_hz, 5000.0, 248e-6)
    plan = plan_scan(scan, dict.fromkeys(names, planned))
    told = Told(lambda _: None, frames.append, lambda *_: None, notes.append)
    known_axes = dict.fromkeys(names, known)
    run_scan(scan, plan, axes, known_axes, stage, (), ScanSetting(file, ""), told)


def test_a_camera_steps_through_a_learned_stack(tmp_path: Path, figure: Figure) -> None:
    """Fifty planes, a hundred pulses a second: none lost; each plane is where it is to be."""
    scan = StackScan.model_validate(
        {
            "planes": {"axis": "x", "from_um": 5, "to_um": 15, "pixels": 50},
            "plane_s": 0.005,
            "move_s": 0.004,
            "interval_us": 280,
            "passes": 3,
            "step": "edge",
        }
    )
    stage, frames, notes = BoardStage(scan.interval_ns, ("x",)), list[FrameReport](), list[str]()
    run(stage, scan, tmp_path / "scan.nxs", frames, notes)
    true = frames[-1].true
    figure(
        f"player board, 50 planes 0.2 µm apart by a camera's pulses, 100 a second: true errors "
        f"{true.slow_rms:.3f} rms, {true.slow_max:.3f} at most, in planes"
    )
    assert [edge.used for edge in stage.edges] == [True] * 50
    assert notes == []
    assert true.slow_rms <= 0.2


@pytest.mark.stress
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("pixels", "lines_per_s", "interval_us"), [(64, 20, 200.0), (256, 10, 156.25)]
)
def test_a_raster_is_learned_and_its_pulses_are_counted(
    pixels: int, lines_per_s: float, interval_us: float, tmp_path: Path, figure: Figure
) -> None:
    """One pulse for each pixel, each line and the frame; errors are parts of a pixel of 64."""
    scan = RasterScan.model_validate(
        {
            "kind": "raster",
            "fast": {"axis": "x", "from_um": 3, "to_um": 23, "pixels": pixels},
            "slow": {"axis": "y", "from_um": 3, "to_um": 23, "pixels": pixels},
            "lines_per_s": lines_per_s,
            "interval_us": interval_us,
            "passes": 8,
            "pulses": {"pixel": 1, "line": 2, "frame": 3},
        }
    )
    stage, frames = BoardStage(scan.interval_ns), list[FrameReport]()
    run(stage, scan, tmp_path / "scan.nxs", frames, [])
    true = frames[-1].true
    figure(
        f"player board, {pixels} x {pixels} pixels at {lines_per_s} lines a second: true errors in "
        f"pixels, worst of the middle: along {true.fast_max:.3f}, from sweep to sweep "
        f"{true.apart_max:.3f}, across {true.slow_max:.3f}"
    )
    n = len(frames)
    assert stage.pulses.tolist() == [n * pixels * pixels, n * pixels, n]
    assert max(true.fast_max, true.apart_max, true.slow_max) <= 0.2 * pixels / 64
