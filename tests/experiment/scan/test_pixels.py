"""Pixels of a sweep, their errors, and what is noise in a correction."""

import numpy as np
import pytest

from piezod.experiment.scan.learn import smoothed
from piezod.experiment.scan.pixels import ErrorCount, SweepSamples, pixels_of
from piezod.experiment.scan.plan import ScanPlan, plan_scan
from tests.experiment.scan.test_plan import AXES, raster


def samples(plan: ScanPlan, sweep: int, late: int = 0) -> SweepSamples:
    """Return a sweep that is exactly on its command, measured some points late."""
    first = sweep % 2 * plan.points
    x = np.roll(plan.lines_um[:, 0], late)[first : first + plan.points]
    position = np.stack((x, np.full(plan.points, plan.levels_um[sweep, 1])), axis=1)
    counts = np.arange(plan.points, dtype=np.float64)[:, None]
    begin_ns = sweep * plan.points * plan.interval_ns
    return SweepSamples(sweep, begin_ns, position, position + np.nan, counts)


def test_a_delay_of_the_sensor_shifts_the_samples() -> None:
    """Measured 3.5 points late, the pixels are where the stage was; an input beside is not late."""
    plan = plan_scan(raster(), AXES)
    late_s = 3 * plan.interval_ns * 1e-9
    pixels = pixels_of(samples(plan, 2, late=3), plan, np.array([late_s, 0.0]))
    centres = 5.25 + 0.5 * np.arange(20)

    assert pixels.position_um[:, 0] == pytest.approx(centres)
    assert pixels.detected[:, 0] == pytest.approx(
        np.arange(plan.active).reshape(20, -1).mean(axis=1)
    )
    assert pixels.first_ns[0] == 2 * plan.points * plan.interval_ns
    assert pixels.last_ns[0] - pixels.first_ns[0] == (plan.per_pixel - 1) * plan.interval_ns
    assert pixels.dwell_s == pytest.approx(plan.per_pixel * 50e-6)


def test_errors_are_in_pixels() -> None:
    """Also from forward to backward, in the middle of the line."""
    plan = plan_scan(raster(), AXES)
    count = ErrorCount(plan)
    for sweep in range(4):
        pixels = pixels_of(samples(plan, sweep), plan, np.zeros(2))
        moved = np.array([0.05 if sweep % 2 else -0.05, 0.25])
        count.add(sweep, pixels.position_um + moved)

    assert count.errors.fast_max == pytest.approx(0.1)
    assert count.errors.apart_max == pytest.approx(0.2)
    assert count.errors.slow_max == pytest.approx(0.1)


def test_corrections_are_smoothed_within_their_way() -> None:
    """Forward and backward stay apart, a slope stays, and noise gets smaller."""
    k = np.arange(200.0)
    slope = np.where(k % 2, 1.0, -1.0) + 0.01 * k
    noise = np.random.default_rng(1).normal(size=200)
    smooth = smoothed((slope + noise)[:, None], 2)[:, 0] - slope

    assert smoothed(slope[:, None], 2)[:, 0] == pytest.approx(slope)
    assert np.std(smooth[20:-20]) < 0.45
    assert smooth[0] == pytest.approx(noise[0])
