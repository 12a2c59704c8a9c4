"""Pulses at positions: at the points at which a motion passes them, or by the device's reading."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.config.scan import LineScan, RasterScan
from piezod.errors import DataError
from piezod.experiment.scan.plan import ScanPlan, check_device, plan_scan
from piezod.experiment.scan.positions import Marks, compared
from tests.experiment.scan.test_plan import AXES, raster
from tests.experiment.scan.test_run import config, scanned


def planned(**other: object) -> ScanPlan:
    """Return the plan of a raster from 5 to 15 µm."""
    given = {"line": 4, "step_um": 0.5, **other}
    sweeps = given.pop("sweeps", "snake")
    return plan_scan(raster(pulses={"pixel": 1, "at": given}, sweeps=sweeps), AXES)


def marked(plan: ScanPlan, late: int = 0) -> Marks:
    """Return the marks of a motion that is some points later than the command."""
    assert plan.marked is not None
    return Marks.of(plan, plan.marked, np.roll(plan.lines_um[:, 0], late))


@pytest.mark.parametrize(
    ("sweeps", "way", "up", "down"),
    [
        ("snake", "both", 21, 21),
        ("snake", "backward", 0, 21),
        ("both", "forward", 21, 0),
        ("forward", "both", 21, 0),
    ],
)
def test_each_sweep_passes_each_position_once(sweeps: str, way: str, up: int, down: int) -> None:
    """Also the ends of the line; turns and flybacks have no pulse."""
    plan = planned(sweeps=sweeps, way=way)
    marks = marked(plan)
    speed = np.gradient(plan.lines_um[:, 0])[marks.point]
    step_um = np.max(np.abs(np.diff(plan.lines_um[: plan.active, 0])))

    assert (np.sum(speed > 0.0), np.sum(speed < 0.0)) == (up, down)
    assert np.max(np.abs(plan.lines_um[marks.point, 0] - marks.wanted_um)) < 0.51 * step_um


def test_pulses_follow_the_motion_that_was_learned() -> None:
    """One that is late by three points pulses three points later; the other lines stay."""
    plan = planned(from_um=6.01, to_um=14.0)
    early, late = marked(plan), marked(plan, 3)
    mask = late.mask(plan)
    rising = np.flatnonzero(np.diff(mask >> 3 & 1, prepend=0) == 1)

    assert np.array_equal(late.point, early.point + 3)
    assert np.array_equal(rising, late.point)
    assert np.array_equal(mask & 1, np.tile(plan.pulses & 1, 2))


def test_noise_makes_no_second_pulse() -> None:
    """A motion that goes back and forth by noise passes a position once, on the average there."""
    plan = planned()
    assert plan.marked is not None
    noise_um = np.random.default_rng(1).normal(0.0, 0.02, plan.lines_um[:, 0].size)
    marks = Marks.of(plan, plan.marked, plan.lines_um[:, 0] + noise_um)

    assert marks.point.size == 42
    assert abs(np.mean(marks.point - marked(plan).point)) < 0.5


def test_a_device_compares_its_late_reading() -> None:
    """At the speed of a sweep the sensor shows a position before: the way has its sign."""
    plans = [planned(by="device", way=way) for way in ("forward", "backward")]
    up, down = (compared(plan, plan.marked, 0.001) for plan in plans if plan.marked)
    speed = 10.0 / (plans[0].active * 50e-6)

    assert up is not None
    assert down is not None
    ends = 5.0 - 0.001 * speed, 15.0 + 0.001 * speed
    assert up == pytest.approx((4, 0, ends[0], ends[0] + 10.25, 0.5))
    assert down == pytest.approx((4, 0, ends[1], ends[1] - 10.25, -0.5))


@pytest.mark.parametrize(
    ("ways", "by", "words"),
    [((), "time", "does not pulse at positions"), (("time",), "device", "not compare")],
)
def test_a_device_that_cannot_pulse_there_refuses(
    ways: tuple[str, ...], by: str, words: str
) -> None:
    """Before anything moves: a board, whose pulses are regular, and one that cannot compare."""
    at = {"line": 1, "step_um": 0.5, "way": "forward", "by": by}
    scan = raster(pulses={"at": at})
    with pytest.raises(DataError, match=words):
        check_device(scan, 0, ways)

    check_device(scan, 0, ("time", "device"))


def test_pulses_come_where_the_stage_is(tmp_path: Path) -> None:
    """On the simulated stage within four points of the table; the file says how."""
    given = config(tmp_path).scan
    assert isinstance(given, RasterScan)
    at = {"line": 4, "positions_um": (7.0, 9.5, 10.0, 17.0), "way": "both"}
    line = LineScan.model_validate(
        {"fast": given.fast, "repeats": 12, "lines_per_s": 20.0, "passes": 2, "pulses": {"at": at}}
    )
    result, _, notes = scanned(tmp_path, line)
    with h5py.File(result.file) as opened:
        pulses = opened["scan/pulses"]
        wanted_um, off_um = pulses["wanted_um"][()], pulses["true_error_um"][()]
        first_ns = opened["scan/pixels/first_ns"][()]
        pulse_ns, way = pulses["pulse_ns"][()], pulses.attrs["way"]
    assert result.pulses is not None
    point_um = 12.0 / (result.plan.active)

    assert (way, result.pulses["way"]) == ("by time from the learned motion",) * 2
    assert wanted_um.reshape(12, 4)[:2].tolist() == [[7.0, 9.5, 10.0, 17.0], [17.0, 10.0, 9.5, 7.0]]
    assert np.max(np.abs(off_um)) < 4.0 * point_um
    assert result.pulses["true_max_um"] == pytest.approx(np.max(np.abs(off_um)))
    assert first_ns[0] <= pulse_ns[0]
    assert (np.diff(pulse_ns) > 0).all()
    assert notes[-1].endswith(f"0, 0, 0, {3 * 12 * 4}")
    assert "by time from the learned motion" in notes[-2]
