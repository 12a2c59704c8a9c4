"""Fast waveforms are learned on a device in another process, whatever the time of this one."""

import time
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from piezod.config.channels import LineCalibration
from piezod.control.table_guard import TableGuard
from piezod.devices.played_axis import AxisRecord, AxisTable, PlayedAxis
from piezod.devices.player import PlayState
from piezod.devices.wiring import ChannelPair
from piezod.experiment.play.command import command_of
from piezod.experiment.play.learn import learn
from piezod.experiment.play.stage import AtRest
from piezod.experiment.play.task import PlaySettings
from piezod.experiment.play.zeroed import ZeroedAxis
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.gcs import dialogue
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated
from tests.drivers.bus.played_table import make
from tests.drivers.bus.test_learned import WAVES, interval_of, known_axis, wave_of
from tests.drivers.bus.test_plays import LABJACK, PI_TCP, Player
from tests.experiment.play.rig_axis import LIMITS

# The sensor is exact, so that the error of its samples is that of the displacement.
RIG = """
rate_hz: 500
seed: 1
devices:
  rig:
    driver: simulated
    options:
      amplifier: {current_limit_a: 1, slew_v_per_s: 300000, capacitance_uf: 3}
      sensor: {antialias_hz: 5000, bandwidth_hz: 10000, delay_s: 0.00011}
      effects: {sensor_noise: false}
      calibration: {kind: commissioned, residual_pct: 0}
axes:
  x:
    amplifier: rig
    sensor: rig
    limits: {drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 250000, rest_v: 0}
    command_range_um: [0, 26]
"""
SETTINGS = PlaySettings(passes=6, settle_s=2.0, record_s=0.5)
RAMP_S = 0.1
LONGEST_S = 60.0


class DistantAxis:
    """Implements `PlayedStage` for a device of another process.

    Args:
        player: The device.
        where: Its place.
        interval_ns: Time between two points, in ns.
    """

    def __init__(self, player: Player, where: str, interval_ns: int) -> None:
        (output,), (input_,) = player.wiring.outputs, player.wiring.inputs
        scales = LineCalibration(gain=5.0), LineCalibration(gain=30.0)
        pair = ChannelPair("device", "device", input_, output)
        if player is LABJACK:
            pair = ChannelPair("device", "device", input_, output, *scales)
        self._device = make(player.driver, player.options_at(where), player.wiring)
        self._axis = PlayedAxis("x", {"device": self._device}, {"x": pair})
        able = self._axis.capabilities
        self._guard = TableGuard(LIMITS, 0.0, able.at_end, able.cycles)
        self._interval_ns, self._in_force_v = interval_ns, 0.0

    def rest(self) -> AtRest:
        """Play a ramp to 0 V."""
        n = round(RAMP_S * NS_PER_S / self._interval_ns)
        down_v = self._in_force_v * (0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n))
        self.play(AxisTable(self._interval_ns, down_v, np.zeros(n), 10))
        return AtRest(time.monotonic(), self._in_force_v)

    def play(self, table: AxisTable) -> AxisRecord:
        """Play a table that the guard accepts."""
        self._guard.check(table, self._in_force_v)
        loaded = self._axis.load(table, time.monotonic_ns())
        self._device.arm()
        self._device.start(time.monotonic_ns())
        eventually(self._has_ended, LONGEST_S)
        self._in_force_v = float(loaded.period_v[-1])
        return self._axis.recording()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._device.close()

    def _has_ended(self) -> bool:
        progress = self._device.progress(time.monotonic_ns())
        assert progress.state in {PlayState.PLAYING, PlayState.ENDED}, progress
        return progress.state is PlayState.ENDED


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait longer for replies: an emulator on a busy computer is slower than a controller."""
    monkeypatch.setattr(dialogue, "OPENING_NS", 10 * NS_PER_S)


PI = PI_TCP._replace(options={**PI_TCP.options, "wave_end": "holds"})


@pytest.mark.stress
@WAVES
@pytest.mark.parametrize("player", [LABJACK, PI], ids=lambda each: each.profile)
def test_waveforms_are_learned_over_a_bus(
    player: Player, kind: str, frequency_hz: float, tmp_path: Path
) -> None:
    """The error is at most 0.2 % of the swing, at worst, after six passes."""
    small = player is LABJACK
    interval_ns = interval_of(frequency_hz, small)
    known = known_axis(interval_ns, interval_ns / NS_PER_S if small else 0.0)
    task = known.task(command_of(wave_of(kind, frequency_hz), interval_ns), SETTINGS)
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG, encoding="utf-8")
    with (
        emulated(player.profile, arguments=("--config", str(rig))) as devices,
        DistantAxis(player, devices.where[0], interval_ns) as distant,
    ):
        learned = learn(ZeroedAxis(distant, interval_ns), task, lambda _: None)
    assert learned.best.measured.max_pct <= 0.2, learned.stopped
