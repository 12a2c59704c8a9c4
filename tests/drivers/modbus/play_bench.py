"""A LabJack and its player in one process, in virtual time."""

from dataclasses import dataclass
from typing import Final

from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.interface import Wiring
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.driver import make_device
from piezod_drivers.modbus.emulation.labjack import LabJackServer
from piezod_drivers.modbus.options import ModbusOptions
from tests.drivers.modbus.emulated import transactions_over
from tests.drivers.modbus.stream_line import StreamLine
from tests.drivers.play_bench import PlayBench, Scale
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

ONE: Final = Wiring(("AIN0",), ("DAC0",))
SCALE: Final = Scale(0.0, 2.0, 1.0, lambda value: value * 30, 50_000, 1e-3)
sine = SCALE.sine


@dataclass
class LabJackBench(PlayBench):
    """A LabJack, active, with everything at its other end."""

    @property
    def stream(self) -> StreamLine:
        """The line of its stream."""
        (stream,) = self.streams
        assert isinstance(stream, StreamLine)
        return stream


def play_bench(
    plugin: EmulatorPlugin = emulator.LABJACK_T7,
    wiring: Wiring = ONE,
    watchdog: dict[str, float] | None = None,
) -> LabJackBench:
    """Return an active device."""
    rig_bench, rig, time = bench(max(len(wiring.inputs), len(wiring.outputs)))
    assert plugin.create is not None
    server = plugin.create(rig_bench, "")
    assert isinstance(server, LabJackServer)
    line, stream = EmulatedLine(server, time), StreamLine(server, time)
    options = ModbusOptions.model_validate(
        {"profile": plugin.name, "host": "h", "watchdog": watchdog}
    )

    def connect(wiring: Wiring, its_stream: StreamLine | None = None) -> ExchangingPlayingBusDevice:
        its_line = its_stream or StreamLine(server, time)
        device = make_device(options, wiring, transactions_over(line, options), its_line)
        assert isinstance(device, ExchangingPlayingBusDevice)
        return device

    device = connect(wiring, stream)
    opened = LabJackBench(device, line, rig, time, server, SCALE, connect, wiring, (stream,))
    opened.opened()
    return opened
