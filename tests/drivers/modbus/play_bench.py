"""A LabJack and its player in one process, in virtual time."""

from dataclasses import dataclass
from math import pi

import numpy as np

from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.interface import Wiring
from piezod.devices.player import PlayState, Progress, Table
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.driver import make_device
from piezod_drivers.modbus.emulation.labjack import LabJackServer
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.stream_arrays import FloatArray
from tests.drivers.modbus.emulated import transactions_over
from tests.drivers.modbus.stream_line import StreamLine
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import MS, EmulatedLine, TestTime

ONE = Wiring(("AIN0",), ("DAC0",))
STEP_NS = 10 * MS
"""Time between two calls of `progress`."""


@dataclass
class PlayBench:
    """A device, active, with everything at its other end.

    Attributes:
        device: The device.
        line: Its line for requests.
        stream: Its line for the stream.
        rig: The rig.
        time: The clock.
        emulator: The emulated device.
    """

    device: ExchangingPlayingBusDevice
    line: EmulatedLine
    stream: StreamLine
    rig: LinearRig
    time: TestTime
    emulator: LabJackServer

    def start(self, table: Table) -> Table:
        """Load a table and start it; return it as it is played."""
        loaded = self.device.load(table)
        self.device.arm()
        self.device.start(self.time.t_ns)
        return loaded

    def wait(self, for_ns: int) -> None:
        """Let time pass without requests."""
        self.time.t_ns += for_ns
        self.emulator.due()

    def progress_to_end(self) -> Progress:
        """Ask for the progress until the play has ended or failed."""
        for _ in range(2000):
            self.wait(STEP_NS)
            found = self.device.progress(self.time.t_ns)
            if found.state is not PlayState.PLAYING:
                return found
        raise AssertionError("the play does not end")

    def another_device(self, wiring: Wiring = ONE) -> ExchangingPlayingBusDevice:
        """Return a device of another process for the same LabJack; it is not open."""
        options = ModbusOptions.model_validate({"profile": "labjack-t7", "host": "t7"})
        device = make_device(
            options,
            wiring,
            transactions_over(self.line, options),
            StreamLine(self.emulator, self.time),
        )
        assert isinstance(device, ExchangingPlayingBusDevice)
        return device


def play_bench(
    plugin: EmulatorPlugin = emulator.LABJACK_T7,
    wiring: Wiring = ONE,
    watchdog: dict[str, float] | None = None,
) -> PlayBench:
    """Return an active device."""
    rig_bench, rig, time = bench(max(len(wiring.inputs), len(wiring.outputs)))
    assert plugin.create is not None
    server = plugin.create(rig_bench, "")
    assert isinstance(server, LabJackServer)
    line, stream = EmulatedLine(server, time), StreamLine(server, time)
    options = ModbusOptions.model_validate(
        {"profile": plugin.name, "host": "h", "watchdog": watchdog}
    )
    device = make_device(options, wiring, transactions_over(line, options), stream)
    assert isinstance(device, ExchangingPlayingBusDevice)
    device.open()
    device.activate(time.t_ns)
    return PlayBench(device, line, stream, rig, time, server)


def sine(n: int = 100, cycles: int = 3, n_outputs: int = 1, interval_ns: int = 50_000) -> Table:
    """Return a table: a ramp from 0 V to 2 V in 20 points, then a sine of 1 V around 2 V."""
    ramp: FloatArray = np.tile(np.linspace(0.0, 2.0, 20)[:, None], n_outputs)
    phase = 2 * pi * np.arange(n) / n
    period = 2.0 + np.stack([np.sin(phase + k) for k in range(n_outputs)], axis=1)
    return Table(interval_ns, ramp, period, cycles)


def played(table: Table) -> FloatArray:
    """Return every point of a play, in order."""
    return np.concatenate((table.lead_in, *([table.period] * table.cycles)))
