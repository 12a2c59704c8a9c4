"""Detection of a loop that did not leave its stage at the safe voltage."""

from math import nan

import pytest

from piezod.config.states import State
from tests.daemon.bench import Bench


def test_loop_that_never_ran_is_safe(bench: Bench) -> None:
    """A loop without a cycle has written nothing."""
    assert bench.loop.ended_at_safe_voltage()
    assert not bench.loop.devices_opened


@pytest.mark.parametrize(("drive_v", "safe"), [(0.7, True), (0.8, False), (float("nan"), False)])
def test_voltage_at_the_end_decides(bench: Bench, drive_v: float, safe: bool) -> None:
    """It may differ by the read-back tolerance, 0.5 % of 150 V; NaN is not safe."""
    bench.record(State.STOPPING, drive_v=drive_v)

    assert bench.loop.ended_at_safe_voltage() is safe


@pytest.mark.parametrize(
    ("before_v", "read_back_v", "reports", "safe"),
    [
        (70.6, 70.6, True, False),
        (70.6, 70.6, False, False),
        (0.7, 0.7, True, True),
        (3.0, 3.0, True, False),
        (0.7, nan, True, True),
        (70.6, nan, True, False),
        (nan, nan, True, False),
        (nan, nan, False, True),
    ],
)
def test_write_at_the_end_is_believed_only_without_a_read_back(
    bench: Bench, before_v: float, read_back_v: float, reports: bool, safe: bool
) -> None:
    """The newest read-back counts, and one may be missing."""
    device = bench.loop.config.axes["x"].amplifier.device
    reported = {"name": device, "capabilities": {"read_back": reports}}
    bench.loop.shared.set_report({"devices": [reported]})
    bench.record(State.RAMP, drive_v=0.0, read_back_v=before_v)
    bench.record(State.STOPPING, drive_v=0.0, read_back_v=read_back_v)

    assert bench.loop.ended_at_safe_voltage() is safe


def test_voltage_of_a_blind_stage_is_unknown(bench: Bench) -> None:
    """The last voltage need not be in force."""
    bench.record(State.BLIND, drive_v=0.0)
    bench.record(State.STOPPING, drive_v=0.0)

    assert not bench.loop.ended_at_safe_voltage()


def test_shadow_is_safe(bench: Bench) -> None:
    """A loop in shadow has written nothing."""
    bench.record(State.STOPPING, shadow=True, drive_v=80.0)

    assert bench.loop.ended_at_safe_voltage()
