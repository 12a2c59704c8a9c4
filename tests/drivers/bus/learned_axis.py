"""An axis of an emulated device that plays tables of a simulated stage, in virtual time."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from piezod.control.table_guard import TableGuard
from piezod.devices.bus.playing_device import PlayingBusDevice
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator
from piezod.devices.interface import Sample, Wiring
from piezod.devices.outputs import CalibratedOutput
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.player import PlayState
from piezod.devices.wiring import ChannelPair
from piezod.experiment.play.stage import AtRest
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.drivers.serial_line.scripted_line import MS, TestTime
from tests.experiment.play.rig_axis import INTERVAL_NS, LIMITS, OPTIONS

RAMP_NS, REST_NS, ZERO_NS = 100 * MS, 200 * MS, 500 * MS
"""Time of a ramp to 0 V, of a rest there, and of the rest that zeroes the sensor."""


class TrueRig(SimulatedRig):
    """A simulated stage; it keeps its true displacement at each read."""

    def __init__(self, sub_step_us: int) -> None:
        options = SimulatedOptions.model_validate({**OPTIONS, "sub_step_us": sub_step_us})
        super().__init__(options, Wiring(("x", "x_v"), ("x",)), 1)
        self.true_um: list[float] = []

    def read(self, now_ns: int) -> Sequence[Sample]:
        samples = super().read(now_ns)
        self.true_um.append(self.true_position_um(now_ns)[0])
        return samples


class TrueBench(SharedRig):
    """A shared rig that forgets the displacements before each play."""

    def __init__(self, rig: TrueRig, time: TestTime) -> None:
        super().__init__(rig, time.now_ns)
        self._true_rig = rig

    def start_ns(self) -> int:
        self._true_rig.true_um.clear()
        return super().start_ns()


class Connected(NamedTuple):
    """A device, active, and its emulator."""

    device: PlayingBusDevice  #: The device.
    emulator: Emulator  #: The emulated device.
    pair: ChannelPair  #: Its channels.
    held_ns: int = 0  #: Time for which it holds the first point, and which it does not record.


Connect = Callable[[SharedRig, TestTime], Connected]


class LearnedAxis:
    """Implements `PlayedStage`.

    Args:
        connect: Connects a device to a rig.
        interval_ns: Time between two points, in ns.
        sub_step_us: Step of the rig, in µs.
    """

    def __init__(
        self, connect: Connect, interval_ns: int = INTERVAL_NS, sub_step_us: int = 50
    ) -> None:
        self._time, self._rig = TestTime(), TrueRig(sub_step_us)
        self._interval_ns = interval_ns
        self._rig.open()
        self._rig.activate(self._time.t_ns)
        connected = connect(TrueBench(self._rig, self._time), self._time)
        self._device, self._emulator = connected.device, connected.emulator
        pair, self._n_held = connected.pair, connected.held_ns // interval_ns
        self._to_v = CalibratedOutput(pair.to_v)
        self._played = PlayedAxis("x", {"device": self._device}, {"x": pair})
        able = self._played.capabilities
        self._guard = TableGuard(LIMITS, 0.0, able.at_end, able.cycles)
        self._zero = 0.0, 0.0
        record = self._play_now(self._at_rest(np.zeros(0), ZERO_NS))
        self._zero = float(np.mean(record.position_um)), float(np.mean(record.true_um))

    def rest(self) -> AtRest:
        """Play a ramp to 0 V."""
        n = round(RAMP_NS / self._interval_ns)
        down_v = self._in_force_v() * (0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n))
        self._play_now(self._at_rest(down_v, REST_NS))
        return AtRest(self._time.t_ns / NS_PER_S, self._in_force_v())

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table that the guard accepts."""
        self._guard.check(table, self._in_force_v())
        return self._play_now(table)

    def _at_rest(self, lead_in_v: FloatArray, duration_ns: int) -> AxisTable:
        """Return a table whose period is one point at rest, repeated for a duration."""
        cycles = round(duration_ns / self._interval_ns)
        return AxisTable(self._interval_ns, lead_in_v, np.zeros(1), cycles)

    def _in_force_v(self) -> float:
        return self._to_v.voltage(self._device.read_back(self._time.t_ns)[0])

    def _play_now(self, table: AxisTable) -> AxisPlayRecord:
        self._played.load(table, self._time.t_ns)
        self._device.arm()
        self._device.start(self._time.t_ns)
        while True:
            self._time.t_ns += 10 * MS
            self._emulator.due()
            progress = self._device.progress(self._time.t_ns)
            if progress.state is not PlayState.PLAYING:
                break
        assert progress.state is PlayState.ENDED, progress
        record = self._played.recording()
        true_um = np.array(self._rig.true_um[self._n_held :][: record.position_um.size])
        return record._replace(
            position_um=record.position_um - self._zero[0], true_um=true_um - self._zero[1]
        )
