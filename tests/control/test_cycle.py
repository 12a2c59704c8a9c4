"""Tests of one cycle: its steps, their order, and the effect of a refused write."""

from collections.abc import Sequence

import pytest

from piezod.control.cycle import CycleAxis, CycleParts, run_cycle
from piezod.control.guard import Guard, Limits
from piezod.control.stage.boundary import DeviceBoundary
from piezod.devices.interface import Sample
from tests.control.fakes import MS, FakeAxis, FakeDevices

TWO_SAMPLES = (Sample(0, 1.5, valid=True), Sample(0, 2.5, valid=True))


def parts_of(
    devices: FakeDevices, axes: Sequence[CycleAxis], low_v: float = 0.0, *, reads_back: bool = False
) -> CycleParts:
    """Return a cycle at 1 kHz with at most 5 V per cycle."""
    boundary = DeviceBoundary(devices, len(axes), reads_back=[reads_back] * len(axes), holds=False)
    boundary.open = True
    guard = Guard([Limits(low_v, 150.0, 5000.0)] * len(axes), longest_s=2e-3)
    return CycleParts(boundary, axes, guard, period_s=1e-3)


def two_axes(x_v: float = 3.0, y_v: float = 4.0) -> tuple[list[str], FakeDevices, CycleParts]:
    """Return the log, the devices, and a cycle of two axes with these voltages."""
    log: list[str] = []
    devices = FakeDevices(log, TWO_SAMPLES)
    axes = [FakeAxis(log, "x", x_v), FakeAxis(log, "y", y_v)]
    return log, devices, parts_of(devices, axes)


def one_axis(asked_v: float, low_v: float = 0.0) -> CycleParts:
    """Return a cycle of one axis with this voltage."""
    log: list[str] = []
    devices = FakeDevices(log, TWO_SAMPLES[:1])
    return parts_of(devices, [FakeAxis(log, "x", asked_v)], low_v)


def test_cycle_reads_updates_writes_and_informs_the_axes() -> None:
    """All axes are written in one transaction, after the read and the update."""
    log, devices, _ = two_axes()
    axes = [FakeAxis(log, "x", 3.0), FakeAxis(log, "y", 4.0)]

    run_cycle(parts_of(devices, axes, reads_back=True), 7 * MS)

    assert log == [
        "read at 7000000",
        "read back at 7000000",
        "x updates at 7000000 with 1.5 µm",
        "y updates at 7000000 with 2.5 µm",
        "write [3.0, 4.0] at 7000000",
        "x has 3.0 V",
        "y has 4.0 V",
    ]


def test_record_contains_the_values_of_the_cycle() -> None:
    """Positions and voltages are in the order of the axes."""
    _, _, parts = two_axes()

    record = run_cycle(parts, 7 * MS)

    assert record.t_ns == 7 * MS
    assert [axis.position_um for axis in record.axes] == [1.5, 2.5]
    assert [axis.asked_v for axis in record.axes] == [3.0, 4.0]
    assert [axis.drive_v for axis in record.axes] == [3.0, 4.0]
    assert record.written


def test_refused_write_leaves_the_voltage_in_force() -> None:
    """The axes do not get voltages that the amplifier did not take; the next cycle writes again."""
    log, devices, parts = two_axes()
    devices.refuses = True

    record = run_cycle(parts, 7 * MS)

    assert not record.written
    assert log[-1] == "write [3.0, 4.0] at 7000000"

    devices.refuses = False

    assert run_cycle(parts, 8 * MS).written
    assert log[-2:] == ["x has 3.0 V", "y has 4.0 V"]


def test_missing_sample_of_an_axis_raises() -> None:
    """An axis without a sample is not skipped silently."""
    log: list[str] = []
    devices = FakeDevices(log, TWO_SAMPLES[:1])
    axes = [FakeAxis(log, "x", 3.0), FakeAxis(log, "y", 4.0)]

    with pytest.raises(IndexError):
        run_cycle(parts_of(devices, axes), 0)


def test_guard_limits_every_write() -> None:
    """Only voltages that the guard has limited are written."""
    log, _, parts = two_axes(float("nan"), 400.0)

    record = run_cycle(parts, 0)

    assert [axis.drive_v for axis in record.axes] == [0.0, 5.0]
    assert log[-3:] == ["write [0.0, 5.0] at 0", "x has 0.0 V", "y has 5.0 V"]


def test_cycle_soon_after_a_late_one_may_move_less() -> None:
    """The slew rate counts from the last write, and no step catches up after a pause."""
    parts = one_axis(100.0)
    instants_ns = (0, MS, int(1.9 * MS), 2 * MS, 9 * MS)

    # The fake axis stays at 0 V, so each voltage is the largest step.
    steps_v = [run_cycle(parts, t_ns).axes[0].drive_v for t_ns in instants_ns]

    assert steps_v == pytest.approx([5.0, 5.0, 4.5, 0.5, 5.0])


@pytest.mark.parametrize(("asked_v", "written_v"), [(-9.0, 0.0), (3.0, 3.0), (99.0, 5.0)])
def test_write_after_an_unacknowledged_one_is_within_reach_of_both(
    asked_v: float, written_v: float
) -> None:
    """At 0 V, and perhaps at 5 V, one step leads to 0 to 5 V only."""
    parts = one_axis(asked_v, low_v=-150.0)
    parts.devices.sent_v = (5.0,)

    record = run_cycle(parts, 0)

    assert record.axes[0].drive_v == written_v
