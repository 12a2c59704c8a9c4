"""Lines of the loop in a scan: their pulses, the edges for which it waits, and its file."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import h5py
import numpy as np
import pytest

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.config.scan import AnyScan, StackScan
from piezod.config.waveforms.paths import Points
from piezod.errors import DataError
from piezod.experiment.scan.by_loop import HOLD_S, Cycles, parts_of, plan_by_loop, run_by_loop
from piezod.experiment.scan.loop_lines import (
    PartLines,
    check_lines,
    count_pulses,
    followed,
    lines_of,
)
from piezod.experiment.scan.run import ScanSetting, Told
from piezod.messages.requests import LineEdges
from tests.experiment.scan.test_plan import AXES, raster, span

PERIOD_NS = 1_000_000
LINES = {
    "shutter": {"device": "io", "output": "DO0"},
    "gate": {"device": "io", "output": "DO1"},
    "exposed": {"device": "io", "input": "DI0"},
}
SNAKE = raster(
    mode=Mode.TRIMMED,
    lines_per_s=2.0,
    pulses={"pixel": "shutter", "line": "gate"},
    start="edge",
    edge="exposed",
)


def stack(planes: int = 6) -> StackScan:
    """Return a stack whose planes an edge ends."""
    given = {"planes": span("x", planes), "plane_s": 0.02, "move_s": 0.01, "mode": Mode.TRIMMED}
    given |= {"step": "edge", "edge": "exposed", "within_s": 0.2, "pulses": {"pixel": "shutter"}}
    return StackScan.model_validate(given)


def test_pulses_begin_half_a_cycle_before_their_pixel() -> None:
    """So the nearest cycle begins them, and none comes before the edge that starts the scan."""
    plan = plan_by_loop(SNAKE, AXES, PERIOD_NS)
    part = next(parts_of(plan))
    zero_s = HOLD_S - 1e-3 * part.first
    pixel, line = lines_of(SNAKE, plan, part.sweeps, zero_s).pulses
    edges = lines_of(SNAKE, plan, part.sweeps, zero_s).edges

    assert pixel.begins_s == line.begins_s
    assert np.diff(pixel.begins_s) == pytest.approx(1e-3 * plan.points)
    assert (pixel.times, line.times, len(line.begins_s)) == (plan.pixels, 1, plan.sweeps)
    assert pixel.every_s == pytest.approx(1e-3 * plan.per_pixel)
    assert pixel.high_s == pytest.approx(1e-3 * plan.high)
    assert edges is not None
    assert edges.first_s == pixel.begins_s[0] == pytest.approx(zero_s - 0.5e-3)
    assert lines_of(SNAKE, plan, range(1, 2), zero_s).edges is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pulses": {"pixel": "laser"}}, r"pulses.pixel: no line 'laser'; the stage has shutter"),
        ({"pulses": {"line": "exposed"}}, r"pulses.line: line exposed is an input"),
        ({"edge": "laser"}, r"edge: no line 'laser'"),
    ],
)
def test_lines_that_the_stage_lacks_are_refused(change: dict[str, Any], words: str) -> None:
    """Before anything moves."""
    check_lines(SNAKE, LINES)
    with pytest.raises(DataError, match="y is a user axis"):
        check_lines(SNAKE, LINES, ["y", "rz"])
    wrong = type(SNAKE).model_validate({**SNAKE.model_dump(), **change})
    with pytest.raises(DataError, match=words):
        check_lines(wrong, LINES)


def test_motion_stands_still_until_the_edge() -> None:
    """The time of a wait is left out; an edge before it moves nothing."""
    edges = LineEdges(line="exposed", first_s=0.010, every_s=0.010, times=2, within_s=0.050)
    high = np.isin(np.arange(80), [4, 30, 31])
    moment = followed(edges, np.arange(80) * PERIOD_NS, high)

    assert moment.t_s[[9, 10, 20, 30, 35, 40, 79]] == pytest.approx(
        [0.009, 0.010, 0.010, 0.010, 0.015, 0.020, 0.020]
    )
    assert [(edge.t_ns // PERIOD_NS, edge.used) for edge in moment.edges] == [(4, 0), (30, 1)]
    assert not moment.ended
    assert followed(edges, np.arange(200) * PERIOD_NS, np.zeros(200, bool)).ended


def test_pulses_are_counted_in_the_records() -> None:
    """Each rising edge of a bit is one."""
    masks = np.array([0, 1, 1, 2, 3, 0, 1], np.int64)

    assert count_pulses(masks, ["shutter", "gate"]) == {"shutter": 3, "gate": 1}


class FollowingStage:
    """Follows waveforms exactly, at 1 kHz; edges come at the given times, in s."""

    def __init__(self, edges_s: tuple[float, ...]) -> None:
        self._edges = {round(1000.0 * each) for each in edges_s}

    def begin(self) -> None:
        """Begin."""

    def follow(
        self, waveforms_um: Mapping[str, Points], duration_s: float, lines: PartLines
    ) -> Cycles:
        """Return the cycles, to some time after the longest wait."""
        since_ns = np.arange(round(1000.0 * duration_s) + 1500) * PERIOD_NS
        high = np.isin(np.arange(since_ns.size), list(self._edges))
        moment = followed(lines.edges, since_ns, high)
        moves = np.diff(moment.t_s, prepend=-1.0) > 0.0
        t_s = moment.t_s[moves]
        (wave,) = (each.built(duration_s) for each in waveforms_um.values())
        position_um = np.array(wave.sample(t_s))[:, None]
        nothing = np.full(position_um.shape, np.nan)
        late_ns = np.zeros(t_s.size)
        return Cycles(t_s, t_s[:, None], position_um, nothing, late_ns, moment.edges, moment.ended)


def scanned(scan: AnyScan, edges_s: tuple[float, ...], file: Path) -> list[str]:
    """Scan, and return what was told."""
    plan = plan_by_loop(scan, AXES, PERIOD_NS)
    notes = list[str]()
    told = Told(lambda _: None, lambda _: None, lambda *_: None, notes.append)
    axis = SimpleNamespace(sensor=None, compensator=SimpleNamespace(sensor_delay_s=0.0))
    axes = [cast("AxisConfig", axis)] * len(plan.axes)
    run_by_loop(scan, plan, axes, FollowingStage(edges_s), ScanSetting(file, "text"), told)
    return notes


@pytest.mark.parametrize(("come", "planes"), [(6, 6), (3, 4)])
def test_edges_end_the_planes(tmp_path: Path, come: int, planes: int) -> None:
    """The file has each plane at its time; without an edge it has the planes so far."""
    edges_s = tuple(HOLD_S + 0.05 + 0.1 * k for k in range(come))
    notes = scanned(stack(), (HOLD_S + 0.01, *edges_s), tmp_path / "scan.nxs")
    with h5py.File(tmp_path / "scan.nxs") as file:
        pixels, edges = file["scan/pixels"], file["scan/edges"]
        first_ns, used = pixels["first_ns"][()], edges["used"][()]
        position_um = pixels["position_x_um"][()]

    assert used.tolist() == [0] + [1] * come
    assert first_ns.size == planes
    assert np.diff(first_ns) / 1e9 == pytest.approx(([0.06] + [0.1] * 5)[: planes - 1], abs=2e-3)
    centres_um = 5.0 + 10.0 / 6.0 * (np.arange(6) + 0.5)
    assert position_um.ravel()[:planes] == pytest.approx(centres_um[:planes], abs=0.01)
    assert ("sweeps are stored" in " ".join(notes)) is (planes < 6)
    assert any("came too early" in note for note in notes)


def test_stack_that_waits_is_one_request() -> None:
    """More planes than it takes are refused with their number."""
    plan = plan_by_loop(stack(150), AXES, PERIOD_NS)

    assert len(list(parts_of(plan))) == 1
    with pytest.raises(DataError, match=r"of at most \d+ planes \(got 900\)"):
        plan_by_loop(stack(900), AXES, PERIOD_NS)
