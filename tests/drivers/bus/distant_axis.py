"""An axis of a device that is emulated in another process."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from piezod.config.channels import LineCalibration
from piezod.control.table_guard import TableGuard
from piezod.devices.interface import Identity
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.player import PlayState
from piezod.devices.wiring import ChannelPair
from piezod.experiment.play.stage import AtRest
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S
from tests.daemon.waiting import eventually
from tests.drivers.bus.played_table import make
from tests.drivers.bus.test_plays import LABJACK, Player
from tests.experiment.play.rig_axis import INTERVAL_NS, LIMITS

RAMP_S = 0.1
LONGEST_S = 60.0


class DistantAxis:
    """Implements `IdentifiedStage`; it also knows the true displacement.

    Args:
        player: The device.
        where: Its place.
        truth: File with the true displacement of the last play.
    """

    def __init__(self, player: Player, where: str, truth: Path) -> None:
        (output,), (input_,) = player.wiring.outputs, player.wiring.inputs
        scales = LineCalibration(gain=5.0), LineCalibration(gain=30.0)
        pair = ChannelPair("device", "device", input_, output)
        if player is LABJACK:
            pair = ChannelPair("device", "device", input_, output, *scales)
        self.identity = Identity(player.profile, "", "", "")
        self._device = make(player.driver, player.options_at(where), player.wiring)
        self._axis = PlayedAxis("x", {"device": self._device}, {"x": pair})
        able = self._axis.capabilities
        self._guard = TableGuard(LIMITS, 0.0, able.at_end, able.cycles)
        self._interval_ns, self._in_force_v, self._truth = INTERVAL_NS, 0.0, truth

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def rest(self) -> AtRest:
        """Play a ramp to 0 V."""
        n = round(RAMP_S * NS_PER_S / self._interval_ns)
        down_v = self._in_force_v * (0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n))
        self.play(AxisTable(self._interval_ns, down_v, np.zeros(n), 10))
        return AtRest(time.monotonic(), self._in_force_v)

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard accepts."""
        self._guard.check(table, self._in_force_v)
        self._truth.unlink(missing_ok=True)
        loaded = self._axis.load(table, time.monotonic_ns())
        self._device.arm()
        self._device.start(time.monotonic_ns())
        eventually(self._has_ended, LONGEST_S)
        self._in_force_v = float(loaded.period_v[-1])
        record = self._axis.recording()
        return record._replace(true_um=self._true_um()[: record.position_um.size])

    def _true_um(self) -> FloatArray:
        eventually(self._truth.exists, LONGEST_S)
        return np.fromfile(self._truth)

    def _has_ended(self) -> bool:
        progress = self._device.progress(time.monotonic_ns())
        assert progress.state in {PlayState.PLAYING, PlayState.ENDED}, progress
        return progress.state is PlayState.ENDED


@contextmanager
def distant_axis(player: Player, rig: Path) -> Iterator[DistantAxis]:
    """Emulate a device in another process while the block runs.

    Args:
        player: The device.
        rig: Configuration of the rig.
    """
    truth = rig.with_suffix(".true")
    command = [sys.executable, "-m", "tests.drivers.bus.true_emulator", player.profile]
    with subprocess.Popen(
        [*command, str(rig), str(truth)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            where = process.stdout.readline().strip()
            with closing(DistantAxis(player, where, truth)) as axis:
                yield axis
        finally:
            process.stdin.close()
    assert process.returncode == 0
