"""Fast waveforms are learned through the compiled firmware, in virtual time."""

from typing import Final

import pytest

from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import learn
from piezod.experiment.play.task import PlaySettings
from piezod.experiment.play.zeroed import ZeroedAxis
from tests.conftest import Figure
from tests.drivers.bus.test_learned import known_axis
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.simulated_board import BoardAxis, SimulatedBoard

pytestmark = needs_board
INTERVAL_NS: Final = 100_000
"""A lead-in of 0.3 s fits into the memory of an ATmega only with this interval."""
SETTINGS: Final = PlaySettings(passes=12, settle_s=4.0, record_s=0.35)


@pytest.mark.stress
@pytest.mark.parametrize("frequency_hz", [100.0, 200.0])
def test_sines_over_80_percent_are_learned(frequency_hz: float, figure: Figure) -> None:
    """The true error is at most 0.1 % of the swing, at worst, at the points of the table."""
    command_um = {"kind": "sine", "low": 3.0, "high": 28.6, "frequency_hz": frequency_hz}
    wave = WaveConfig.model_validate({"name": "wave", "command_um": command_um}, context=Context())
    board = SimulatedBoard(INTERVAL_NS, ("x",), residual_pct=0.02)
    axis = ZeroedAxis(BoardAxis(board, "x"), INTERVAL_NS)
    task = known_axis(INTERVAL_NS, 0.0).task(command_of(wave, INTERVAL_NS), SETTINGS)
    learned = learn(axis, task, lambda _: None)
    before, best = learned.reports[0].true, learned.best.true
    figure(
        f"player board, sine {frequency_hz:g} Hz: true error in % of the swing, worst: "
        f"{before.max_pct:.2f} without learning, {best.max_pct:.3f} "
        f"(rms {best.rms_pct:.3f}, mean {best.mean_pct:.3f}) "
        f"after {learned.best.label}"
    )
    assert best.max_pct <= 0.1, learned.stopped
