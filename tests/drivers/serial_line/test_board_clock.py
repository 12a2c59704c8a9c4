"""The time of a player board, by the clock of its emulated processor."""

from typing import Final

import pytest

from piezod.devices.interface import Exchanges
from piezod.devices.player import PlayState
from piezod_drivers.serial_line.piezo_board.emulation.simavr import CLOCK_HZ
from tests.conftest import Figure
from tests.drivers.serial_line.board_play_bench import needs_board, play_bench, sine

pytestmark = needs_board
INTERVAL: Final = CLOCK_HZ // 20_000
MOST_OFF: Final = CLOCK_HZ // 2_000_000
"""Cycles of 50 µs, and of 0.5 µs."""


@pytest.mark.parametrize(
    "points", [pytest.param(20_000, id="short"), pytest.param(1_000_000, marks=pytest.mark.stress)]
)
def test_points_come_at_20_khz(points: int, figure: Figure) -> None:
    """None is late, although the host asks all the time; none is more than 0.5 µs off."""
    bench = play_bench()
    table = sine(n=100, cycles=points // 100, n_lead_in=0)
    bench.board.processor.forget()
    bench.start(table)
    ended = bench.progress_to_end()
    seen = bench.board.processor.seen

    assert (ended.state, ended.cycle) == (PlayState.ENDED, points // 100)
    assert seen.points == points
    shortest, longest = INTERVAL - seen.shortest, seen.longest - INTERVAL
    assert max(shortest, longest) <= MOST_OFF
    figure(
        f"{points} points at 20 kHz: none late, {seen.shortest / CLOCK_HZ * 1e6:.2f} to "
        f"{seen.longest / CLOCK_HZ * 1e6:.2f} µs apart"
    )


def test_setpoints_come_at_500_hz(figure: Figure) -> None:
    """Setting the output and reading the input takes at most 2 ms."""
    bench = play_bench()
    assert isinstance(bench.device, Exchanges)
    processor, n = bench.board.processor, 50
    begun = processor.cycle
    for i in range(n):
        accepted, (sample,) = bench.device.exchange([1.0 + 0.01 * i], bench.time.t_ns)
        assert accepted
        assert sample.valid
    rate_hz = n * CLOCK_HZ / (processor.cycle - begun)
    figure(f"setpoint and sample: {rate_hz:.0f} times a second, by the clock of the board")
    assert rate_hz >= 500
