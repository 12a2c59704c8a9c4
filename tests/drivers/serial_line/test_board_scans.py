"""A raster is learned and played through the compiled firmware, in virtual time."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from piezod.config.scan import AnyScan, RasterScan, StackScan
from piezod.devices.played_scan import BlockRecord, PlayedScan
from piezod.devices.player import SeenEdge
from piezod.devices.scan_table import ScanTable
from piezod.experiment.play.axis import PlayingAxis
from piezod.experiment.play.stored import Conditions
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.experiment.scan.learn import FrameReport
from piezod.experiment.scan.pixels import SweepSamples
from piezod.experiment.scan.plan import PlannedAxis, plan_scan
from piezod.experiment.scan.run import ScanSetting, Told, run_scan
from piezod_drivers.serial_line.piezo_board.emulation.simavr import CLOCK_HZ
from tests.conftest import Figure
from tests.drivers.bus.test_learned import known_axis
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.simulated_board import BoardAxis, SimulatedBoard
from tests.experiment.play.rig_axis import RESPONSE, SENSOR_DELAY_S, model

pytestmark = needs_board
AXES: Final = ("x", "y")


class BoardStage(SimulatedBoard):
    """Implements `ScanStage` on a board of two channels.

    Args:
        interval_ns: Time between two points of a table, in ns.
        scanned: Names of the axes that scan.
    """

    def __init__(self, interval_ns: int, scanned: tuple[str, ...] = AXES) -> None:
        super().__init__(interval_ns, AXES, residual_pct=0.01)
        self.scanned = PlayedScan({name: self.played[name] for name in scanned}, self.pairs)
        self.axes: dict[str, ZeroedAxis] = {}
        self.pulses = np.zeros(3, int)  # of points, lines and frames
        self.edges: tuple[SeenEdge, ...] = ()

    def scan(self, table: ScanTable) -> Iterator[SweepSamples]:
        """Play a scan; yield the samples of each sweep."""
        assert not self.scanned.misfit(table)
        zeros = np.array([self.axes[name].zero_um for name in table.axes])
        true_zeros = np.array([self.axes[name].true_zero_um for name in table.axes])
        places, nothing = [AXES.index(name) for name in table.axes], np.empty((0, len(table.axes)))
        rest, k, m = BlockRecord(nothing, nothing, np.empty((0, 0))), 0, table.points
        for block in self.scanned.blocks(table):
            columns = self.scanned.columns(table, block)
            for axis, column in zip(self.scanned.axes, columns, strict=True):
                self.check(axis, column)
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
