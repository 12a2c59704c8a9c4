"""A player board whose channels move simulated stages, and its axes, in virtual time."""

from typing import Final

import numpy as np

from piezod.config.channels import LineCalibration
from piezod.control.table_guard import TableGuard
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.interface import Identity, Wiring
from piezod.devices.outputs import CalibratedOutput
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis, load_together
from piezod.devices.player import PlayState
from piezod.devices.wiring import ChannelPair
from piezod.experiment.play.stage import AtRest
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
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime
from tests.experiment.play.rig_axis import LIMITS, OPTIONS

CODES: Final = 65_535
RAMP_S, REST_S = 0.1, 0.2
_TO_UM: Final = LineCalibration(gain=UM_PER_CODE * CODES / 5.0, offset=LOWEST_UM)
_TO_V: Final = LineCalibration(gain=V_PER_CODE * CODES / 5.0)


class TrueBoard(BoardEmulator):
    """A board that keeps the true displacements at each point of a play."""

    def __init__(self, rig: SimulatedRig, time: TestTime) -> None:
        shared = SharedRig(rig, time.now_ns)
        super().__init__(shared, "")
        self._rig, self._last = rig, shared.n_axes - 1
        self.true_um: list[list[float]] = []

    def _sense(self, channel: int, cycle: int) -> int:
        code = super()._sense(channel, cycle)
        if self.processor.plays and channel == self._last:  # sampled once for each point
            # Each axis has two inputs, its displacement and its voltage.
            self.true_um.append(list(self._rig.true_position_um(self._ns_of(cycle))[::2]))
        return code


class SimulatedBoard:
    """A board, active.

    Args:
        interval_ns: Time between two points of a table, in ns.
        axes: Names of its axes, in the order of channels.
        residual_pct: Residual of the calibration of the sensors, in %.
    """

    def __init__(self, interval_ns: int, axes: tuple[str, ...], residual_pct: float) -> None:
        self.time, self.names, self._interval_ns = TestTime(), axes, interval_ns
        sensor = {"calibration": {"kind": "commissioned", "residual_pct": residual_pct}}
        options = SimulatedOptions.model_validate({**OPTIONS, **sensor})
        inputs = tuple(name for axis in axes for name in (axis, f"{axis}_v"))
        rig = SimulatedRig(options, Wiring(inputs, axes), 1)
        rig.open()
        rig.activate(self.time.t_ns)
        self.board = TrueBoard(rig, self.time)
        channels = tuple(str(i) for i in range(1, len(axes) + 1))
        self.device = make_device(
            EmulatedLine(self.board, self.time),
            BoardOptions(port="p", timeout_ms=100.0, channels=len(axes)),
            Wiring.both(channels),
        )
        self.identity: Identity = self.device.open()
        self.device.activate(self.time.t_ns)
        self._to_v = CalibratedOutput(_TO_V)
        self.pairs = {
            name: ChannelPair("device", "device", channel, channel, _TO_UM, _TO_V)
            for name, channel in zip(axes, channels, strict=True)
        }
        self.played = {name: PlayedAxis(name, {"device": self.device}, self.pairs) for name in axes}
        able = self.played[axes[0]].capabilities
        self._guard = TableGuard(LIMITS, 0.0, able.at_end, able.cycles)

    def in_force_v(self, place: int) -> float:
        """Return the voltage of an axis."""
        return self._to_v.voltage(self.device.read_back(self.time.t_ns)[place])

    def check(self, axis: PlayedAxis, table: AxisTable) -> None:
        """Let the guard see what an axis is to play."""
        self._guard.check(table, self.in_force_v(axis.output))

    def rest(self) -> None:
        """Play a ramp of all axes to 0 V."""
        n = round(RAMP_S * NS_PER_S / self._interval_ns)
        down = 0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n)
        cycles = round(REST_S * NS_PER_S / self._interval_ns)
        axes = tuple(self.played.values())
        tables = [
            AxisTable(self._interval_ns, self.in_force_v(each.output) * down, np.zeros(1), cycles)
            for each in axes
        ]
        for each, table in zip(axes, tables, strict=True):
            self.check(each, table)
        load_together(axes, tables, None, self.time.t_ns)
        self.play_out()
        axes[0].recording()  # as of every play: it takes time

    def play_out(self) -> None:
        """Play what is loaded."""
        player = self.played[self.names[0]].player
        player.arm()
        self.board.true_um.clear()
        player.start(self.time.t_ns)
        while (progress := player.progress(self.time.t_ns)).state is PlayState.PLAYING:
            self.time.t_ns += 20 * MS
            self.board.due()
        assert progress.state is PlayState.ENDED, progress


class BoardAxis:
    """Implements `IdentifiedStage` for one axis of a board; the others rest."""

    def __init__(self, board: SimulatedBoard, name: str) -> None:
        self._board, self._played = board, board.played[name]
        self.identity = board.identity

    def rest(self) -> AtRest:
        """Bring all axes to rest."""
        self._board.rest()
        now_s = self._board.time.t_ns / NS_PER_S
        return AtRest(now_s, self._board.in_force_v(self._played.output))

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard accepts."""
        self._board.check(self._played, table)
        self._played.load(table, self._board.time.t_ns)
        self._board.play_out()
        record = self._played.recording()
        true_um = np.array(self._board.board.true_um[-record.position_um.size :])
        return record._replace(true_um=true_um[:, self._played.output])
