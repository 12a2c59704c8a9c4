"""Plays on a running stage: what is measured before the first one."""

import pytest

from piezod.experiment.live.play import LOWEST_HZ, REST_S, RunningAxis, near_frequency_hz
from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.experiment.play.command import points_of
from tests.experiment.live_fakes import FakeStage


@pytest.mark.parametrize("interval_us", [24, 50, 240, 650])
def test_multisine_has_a_whole_number_of_points(interval_us: int) -> None:
    """Its lowest frequency is near 10 Hz, also for a clock that does not divide 0.1 s."""
    interval_ns = 1000 * interval_us
    frequency_hz = near_frequency_hz(LOWEST_HZ, interval_ns)

    assert frequency_hz == pytest.approx(LOWEST_HZ, rel=0.01)
    assert points_of("the multisine", 1.0 / frequency_hz, interval_ns) > 100


def test_rest_tells_the_time_of_the_daemon() -> None:
    """A drift is told by the times of the plays: those of the clock that drives the stage."""
    client = FakeStage()
    with LiveStage(client, read_setup(client), lambda _s: None) as stage:
        stage.arm()
        axis = RunningAxis(stage, "x", 2.0)
        first, second = axis.rest(), axis.rest()

    assert second.t_s - first.t_s == pytest.approx(REST_S, abs=0.11)
    assert second.drive_v == 2.0
