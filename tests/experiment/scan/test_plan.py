"""The plan of a scan: where the stage is when, and what does not fit."""

import numpy as np
import pytest

from piezod.config.scan import AnyScan, LineScan, PulsesConfig, RasterScan, SpanConfig, StackScan
from piezod.errors import DataError
from piezod.experiment.scan.plan import PlannedAxis, ScanPlan, plan_scan

AXIS = PlannedAxis((0.0, 26.0), 734.0, 4000.0, 0.0005)
AXES = {"x": AXIS, "y": AXIS}


def span(axis: str, pixels: int = 20, from_um: float = 5.0, to_um: float = 15.0) -> SpanConfig:
    """Return a span of 10 µm."""
    return SpanConfig(axis=axis, from_um=from_um, to_um=to_um, pixels=pixels)


def raster(**other: object) -> RasterScan:
    """Return a raster with pulses."""
    pulses = PulsesConfig(pixel=1, line=2, frame=3)
    given = {"fast": span("x"), "slow": span("y", 4), "lines_per_s": 10.0, "pulses": pulses}
    return RasterScan.model_validate({**given, **other})


def position_um(plan: ScanPlan) -> np.ndarray:
    """Return two periods of the fast axis."""
    return np.tile(plan.lines_um[:, 0], 2)


@pytest.mark.parametrize("sweeps", ["forward", "snake", "both"])
def test_a_line_has_even_pixels_and_smooth_turns(sweeps: str) -> None:
    """The speed is constant over the pixels, and neither it nor the acceleration ever jumps."""
    plan = plan_scan(raster(sweeps=sweeps), AXES)
    x = position_um(plan)
    speed, acceleration = np.diff(x), np.diff(x, 2)
    centres = plan.pixel_means(plan.command_um(0))[:, 0]

    assert centres == pytest.approx(5.25 + 0.5 * np.arange(20))
    assert np.ptp(speed[: plan.active - 1]) < 1e-12
    assert np.max(np.abs(np.diff(acceleration))) < 0.05 * np.max(np.abs(speed))
    assert x[plan.points * len(x) // (2 * plan.points) - 1] == pytest.approx(x[-1])


def test_the_stage_stands_still_where_a_scan_may_pause() -> None:
    """There the fast axis is at an end of its motion."""
    for sweeps in ("forward", "snake", "both"):
        plan = plan_scan(raster(sweeps=sweeps), AXES)
        speed = np.abs(np.diff(position_um(plan)))

        assert speed[plan.pause] < 0.1 * np.max(speed)
        assert plan.active < plan.pause < plan.points


def test_both_sweeps_of_a_line_have_its_row() -> None:
    """Forward and backward have the same level of the slow axis."""
    plan = plan_scan(raster(sweeps="both"), AXES)

    assert plan.rows == (0, 0, 1, 1, 2, 2, 3, 3)
    assert plan.levels_um[0, 1] == plan.levels_um[1, 1] == pytest.approx(6.25)
    assert [plan.backward(k) for k in range(4)] == [False, True, False, True]


def test_each_pixel_has_one_pulse() -> None:
    """The line of the pixels rises once in each, that of the sweep once."""
    plan = plan_scan(raster(), AXES)
    rising = [
        int(np.count_nonzero(np.diff(plan.pulses >> bit & 1, prepend=0) == 1)) for bit in (0, 1)
    ]

    assert rising == [20, 1]
    assert plan.framed == 4
    assert plan.pulses[plan.active :].max() == 0


def test_slow_axis_moves_early_by_its_delay() -> None:
    """So that it moves in the turn, and stands still over the pixels."""
    late = {**AXES, "y": AXIS._replace(delay_s=0.002)}
    early = plan_scan(raster(), late).blend[:, 1]
    now = plan_scan(raster(), {**AXES, "y": AXIS._replace(delay_s=0.0)}).blend[:, 1]

    assert early[:-40] == pytest.approx(now[40:])
    assert early[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("scan", "axis", "words"),
    [
        (raster(fast=span("x", to_um=26.0)), AXIS, ("with its turns", "0 to 26 µm")),
        (raster(turn_share=0.02), AXIS, ("excites the first mode", "734 Hz", "2.72 ms")),
        (raster(), AXIS._replace(speed_um_per_s=50.0), ("would move at", "50 µm/s")),
    ],
)
def test_what_does_not_fit_an_axis_is_refused(
    scan: AnyScan, axis: PlannedAxis, words: tuple[str, ...]
) -> None:
    """Before anything moves, with number and remedy."""
    with pytest.raises(DataError) as refused:
        plan_scan(scan, {"x": axis, "y": AXIS})

    assert all(word in str(refused.value) for word in words)


def test_a_stack_holds_its_planes() -> None:
    """A pixel is a plane; one pulse each, 100 a second."""
    scan = StackScan(
        planes=span("z", 50), plane_s=0.007, move_s=0.003, pulses=PulsesConfig(pixel=1)
    )
    plan = plan_scan(scan, {"z": AXIS})

    assert (plan.sweeps, plan.pixels, plan.n_rows) == (50, 1, 50)
    assert plan.points * plan.interval_ns == 10_000_000
    assert np.diff(plan.levels_um[:, 0]) == pytest.approx(0.2)
    assert int(np.count_nonzero(np.diff(plan.pulses, prepend=0) == 1)) == 1


def test_a_line_is_repeated() -> None:
    """Its picture has a row for each repeat."""
    plan = plan_scan(LineScan(fast=span("x"), repeats=3, lines_per_s=10.0, sweeps="both"), AXES)

    assert (plan.n_rows, plan.sweeps, plan.axes) == (3, 6, ("x",))
