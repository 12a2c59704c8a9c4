"""Plays on a running stage: what is measured before the first one."""

import pytest

from piezod.experiment.live.play import LOWEST_HZ, near_frequency_hz
from piezod.experiment.play.command import points_of


@pytest.mark.parametrize("interval_us", [24, 50, 240, 650])
def test_multisine_has_a_whole_number_of_points(interval_us: int) -> None:
    """Its lowest frequency is near 10 Hz, also for a clock that does not divide 0.1 s."""
    interval_ns = 1000 * interval_us
    frequency_hz = near_frequency_hz(LOWEST_HZ, interval_ns)

    assert frequency_hz == pytest.approx(LOWEST_HZ, rel=0.01)
    assert points_of("the multisine", 1.0 / frequency_hz, interval_ns) > 100
