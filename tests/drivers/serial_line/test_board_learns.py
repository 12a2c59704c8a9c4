"""Fast waveforms are learned through the compiled firmware, in virtual time."""

from typing import Final

import numpy as np
import pytest

from piezod.config.channels import LineCalibration
from piezod.config.fields import Context
from piezod.config.play import WaveConfig
from piezod.control.table_guard import TableGuard
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Wiring
from piezod.devices.outputs import CalibratedOutput
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.player import PlayState
from piezod.devices.wiring import ChannelPair
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import learn
from piezod.experiment.play.stage import AtRest
from piezod.experiment.play.task import PlaySettings
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.piezo_board.driver import make_device
from piezod_drivers.serial_line.piezo_board.emulator import (
    LOWEST_UM,
    UM_PER_CODE,
    V_PER_CODE,
    BoardEmulator,
)
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.conftest import Figure
from tests.drivers.bus.test_learned import known_axis
from tests.drivers.serial_line.board_play_bench import needs_board
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime
from tests.experiment.play.rig_axis import LIMITS, OPTIONS

pytestmark = needs_board
INTERVAL_NS: Final = 100_000
"""A lead-in of 0.3 s fits into the memory of an ATmega only with this interval."""
CODES: Final = 65_535
RAMP_S, REST_S = 0.1, 0.2
SETTINGS: Final = PlaySettings(passes=12, settle_s=4.0, record_s=0.35)


class TrueBoard(BoardEmulator):
    """A board that keeps the true displacement at each point of a play."""

    def __init__(self, rig: SimulatedRig, time: TestTime) -> None:
        super().__init__(SharedRig(rig, time.now_ns), "")
        self._rig, self.true_um = rig, list[float]()

    def _sense(self, channel: int, cycle: int) -> int:
        code = super()._sense(channel, cycle)
        if self.processor.plays:
            self.true_um.append(self._rig.true_position_um(self._ns_of(cycle))[0])
        return code


class BoardAxis:
    """Implements `PlayedStage` on an emulated board."""

    def __init__(self) -> None:
        self._time = TestTime()
        sensor = {"calibration": {"kind": "commissioned", "residual_pct": 0.02}}
        options = SimulatedOptions.model_validate({**OPTIONS, **sensor})
        rig = SimulatedRig(options, Wiring(("x", "x_v"), ("x",)), 1)
        rig.open()
        rig.activate(self._time.t_ns)
        self._board = TrueBoard(rig, self._time)
        line = EmulatedLine(self._board, self._time)
        wiring = Wiring.both(("1",))
        self._device = make_device(line, BoardOptions(port="p", timeout_ms=100.0), wiring)
        self._device.open()
        self._device.activate(self._time.t_ns)
        to_um = LineCalibration(gain=UM_PER_CODE * CODES / 5.0, offset=LOWEST_UM)
        to_v = LineCalibration(gain=V_PER_CODE * CODES / 5.0)
        self._to_v = CalibratedOutput(to_v)
        pair = ChannelPair("device", "device", "1", "1", to_um, to_v)
        self._played = PlayedAxis("x", {"device": self._device}, {"x": pair})
        able = self._played.capabilities
        self._guard = TableGuard(LIMITS, 0.0, able.at_end, able.cycles)

    def rest(self) -> AtRest:
        """Play a ramp to 0 V."""
        n = round(RAMP_S * NS_PER_S / INTERVAL_NS)
        down_v = self._in_force_v() * (0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n))
        cycles = round(REST_S * NS_PER_S / INTERVAL_NS)
        self.play(AxisTable(INTERVAL_NS, down_v, np.zeros(1), cycles))
        return AtRest(self._time.t_ns / NS_PER_S, self._in_force_v())

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard accepts."""
        self._guard.check(table, self._in_force_v())
        player = self._played.player
        self._played.load(table, self._time.t_ns)
        player.arm()
        self._board.true_um.clear()
        player.start(self._time.t_ns)
        while (progress := player.progress(self._time.t_ns)).state is PlayState.PLAYING:
            self._time.t_ns += 20 * MS
            self._board.due()
        assert progress.state is PlayState.ENDED, progress
        record = self._played.recording()
        n = record.position_um.size
        return record._replace(true_um=np.array(self._board.true_um[-n:]))

    def _in_force_v(self) -> float:
        return self._to_v.voltage(self._device.read_back(self._time.t_ns)[0])


@pytest.mark.stress
@pytest.mark.parametrize("frequency_hz", [100.0, 200.0])
def test_sines_over_80_percent_are_learned(frequency_hz: float, figure: Figure) -> None:
    """The true error is at most 0.1 % of the swing, at worst, at the points of the table."""
    command_um = {"kind": "sine", "low": 3.0, "high": 28.6, "frequency_hz": frequency_hz}
    wave = WaveConfig.model_validate({"name": "wave", "command_um": command_um}, context=Context())
    axis = ZeroedAxis(BoardAxis(), INTERVAL_NS)
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
