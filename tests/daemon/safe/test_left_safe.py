"""Whether a loop that has ended left its stage safe."""

from pathlib import Path

import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.states import State
from piezod.daemon.loop import accept
from tests.daemon.bench import Bench


@pytest.fixture
def bench(tmp_path: Path, rig_file: Path) -> Bench:
    """Return a stage whose safe voltage is 0 V."""
    config: DaemonConfig = accept.load(rig_file)
    bench = Bench(tmp_path, config)
    bench.link.stage_audit.close()
    return bench


def test_loop_that_never_ran_left_it_as_it_was(bench: Bench) -> None:
    """Without a cycle nothing was written."""
    assert bench.loop.ended_at_safe_voltage()
    assert not bench.loop.devices_opened


@pytest.mark.parametrize(("drive_v", "safe"), [(0.7, True), (0.8, False), (float("nan"), False)])
def test_voltage_at_the_end_decides(bench: Bench, drive_v: float, safe: bool) -> None:
    """It may be off by what a read-back may be, 0.5 % of 150 V; one not known is not safe."""
    bench.record(State.STOPPING, drive_v=drive_v)

    assert bench.loop.ended_at_safe_voltage() is safe


def test_voltage_of_a_stage_out_of_reach_is_not_known(bench: Bench) -> None:
    """What was sent last need not be what is in force."""
    bench.record(State.BLIND, drive_v=0.0)
    bench.record(State.STOPPING, drive_v=0.0)

    assert not bench.loop.ended_at_safe_voltage()


def test_shadow_is_not_to_blame_for_a_voltage(bench: Bench) -> None:
    """A loop that wrote nothing leaves the stage to whoever drives it."""
    bench.record(State.STOPPING, shadow=True, drive_v=80.0)

    assert bench.loop.ended_at_safe_voltage()
