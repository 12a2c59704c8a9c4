"""A spiral of two axes: its path, what does not fit, and a learned one in virtual time."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.config.scan import SpiralScan
from piezod.errors import DataError
from piezod.experiment.scan.pixels import ErrorCount
from piezod.experiment.scan.plan import PlannedAxis, plan_scan
from piezod.records.scan_file import read_scan
from piezod_drivers.simulated.pattern import counts_at
from tests.experiment.scan.test_plan import AXES, AXIS, span
from tests.experiment.scan.test_run import scanned


def spiral(**other: object) -> SpiralScan:
    """Return a spiral of 20 pixels over 10 µm."""
    given = {"x": span("x"), "y": span("y"), "pixel_s": 0.004, "interval_us": 200.0}
    return SpiralScan.model_validate({**given, **other})


def test_a_spiral_has_even_pixels_over_its_disk() -> None:
    """About as many as fit into the disk, half a micrometre apart, each with the same time."""
    plan = plan_scan(spiral(), AXES)
    x, y = (centres - 10.0 for centres in plan.centres_um)
    apart = np.hypot(np.diff(x), np.diff(y))
    radius = np.hypot(x, y)

    assert plan.pixels == pytest.approx(np.pi * 10.0**2, abs=3)
    assert apart[20:] == pytest.approx(0.5, abs=0.02)
    assert radius[-1] == pytest.approx(5.0, abs=0.02)
    assert (np.diff(radius) > 0.0).all()
    # The next turn is a pixel further out.
    angle = np.unwrap(np.arctan2(y, x))
    inside = angle < angle[-1] - 2.0 * np.pi
    outer = np.interp(angle[inside] + 2.0 * np.pi, angle, radius)
    assert (outer - radius[inside])[5:] == pytest.approx(0.5, abs=0.02)


def test_the_centre_is_slow_and_the_way_back_smooth() -> None:
    """A turn about the centre lasts four periods of the lower mode; the speed never jumps."""
    modes = {"x": AXIS, "y": AXIS._replace(mode_hz=200.0)}
    plan = plan_scan(spiral(), modes)
    path = np.vstack((plan.lines_um, plan.lines_um[:2]))
    velocity = np.diff(path, axis=0) / 200e-6
    angle = np.unwrap(np.arctan2(*(plan.lines_um[: plan.active] - 10.0).T[::-1]))

    assert np.max(np.diff(angle)) / 200e-6 <= 2.0 * np.pi * 200.0 / 4.0
    assert np.max(np.abs(np.diff(velocity, axis=0))) < 0.15 * np.max(np.abs(velocity))


@pytest.mark.parametrize(
    ("scan", "axis", "words"),
    [
        (spiral(x=span("x", to_um=26.5, from_um=16.5)), AXIS, "allowed range 0 to 26"),
        (spiral(), AXIS._replace(speed_um_per_s=50.0), "50 µm/s"),
        (spiral(back_s=0.001), AXIS, "back_s"),
        (spiral(interval_us=50.0, pixel_s=0.004), AXIS, "allowed: 20000"),
        (spiral(), AXIS._replace(mode_hz=2.0), "allowed: 20000"),
    ],
)
def test_what_does_not_fit_is_refused(scan: SpiralScan, axis: PlannedAxis, words: str) -> None:
    """Before anything moves."""
    with pytest.raises(DataError, match=words):
        plan_scan(scan, {"x": axis, "y": AXIS})


def test_errors_are_along_and_across_the_path() -> None:
    """A stage that is late by a point errs along it; one that is larger errs across it."""
    plan = plan_scan(spiral(), AXES)
    late, large = ErrorCount(plan), ErrorCount(plan)
    centres = np.stack(plan.centres_um, axis=1)
    late.add(0, plan.pixel_means(np.roll(plan.lines_um, 1, axis=0)[: plan.active]))
    large.add(0, 10.0 + 1.01 * (centres - 10.0))

    assert late.errors.fast_max == pytest.approx(1.0 / plan.per_pixel, rel=0.05)
    assert late.errors.slow_max < 0.01
    assert large.errors.slow_max == pytest.approx(0.095, abs=0.01)
    assert large.errors.fast_max < 0.01
    assert np.isnan(late.errors.apart_max)


def test_a_spiral_is_learned_and_stored_as_a_list(tmp_path: Path) -> None:
    """Both axes follow it within 0.3 pixels; each pixel has its pulse, its place and its counts."""
    scan = SpiralScan.model_validate(
        {
            "x": {"axis": "x", "from_um": 8.0, "to_um": 16.0, "pixels": 12},
            "y": {"axis": "y", "from_um": 8.0, "to_um": 16.0, "pixels": 12},
            "pixel_s": 0.006,
            "interval_us": 200.0,
            "passes": 2,
            "pulses": {"pixel": 1},
        }
    )
    result, frames, notes = scanned(tmp_path, scan)
    stored = read_scan(result.file)
    places = np.stack([values for _, values in stored.scales], axis=1)
    errors = frames[-1].true
    with h5py.File(result.file) as opened:
        assert opened["scan/pixels/position_x_um"].shape == (result.plan.pixels,)

    assert [name for name, _ in stored.scales] == ["x_um", "y_um"]
    assert max(errors.fast_max, errors.slow_max) < 0.3
    counts = stored.pictures["photons"]
    assert counts.shape == (result.plan.pixels,)
    assert np.corrcoef(counts, counts_at(places))[0, 1] > 0.7
    assert notes == [f"pulses of the device, in all frames: {3 * result.plan.pixels}"]
