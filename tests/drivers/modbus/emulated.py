"""Emulated devices for the tests of the driver: in this process, or behind a pty or a TCP port."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.devices.emulation.faults import WireFault, WireFaults
from piezod.devices.emulators import Emulation, EmulationRequest
from piezod.devices.interface import Wiring
from piezod_drivers.modbus.driver import make_device
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.rtu_transactions import RtuTransactions
from piezod_drivers.modbus.tcp_transactions import TcpTransactions
from piezod_drivers.modbus.transactions import Transactions
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

TIMEOUT_S = 0.05


def transactions_over(line: EmulatedLine, options: ModbusOptions) -> Transactions:
    """Return the transactions of some options over a line of a test."""
    if options.host is not None:
        return TcpTransactions(line, TIMEOUT_S)
    units = [unit.unit for unit in options.every_unit]
    return RtuTransactions(line, TIMEOUT_S, units, options.silence_s)


def emulated(
    plugin: EmulatorPlugin,
    options: ModbusOptions,
    wiring: Wiring,
    serial: str = "",
    kind: type[EmulatedLine] = EmulatedLine,
) -> tuple[BusDevice, EmulatedLine, LinearRig]:
    """Return a device that is not open, its line of this class, and the rig at the other end."""
    table, rig, clock = bench(max(len(wiring.inputs), len(wiring.outputs)))
    assert plugin.create is not None
    line = kind(plugin.create(table, serial), clock)
    return make_device(options, wiring, transactions_over(line, options)), line, rig


@contextmanager
def served(
    plugin: EmulatorPlugin, where: str = "", faults: Sequence[WireFault] = ()
) -> Iterator[str]:
    """Serve a device at a pty or a TCP port in a thread of its own; yield its place."""
    rig = LinearRig(1)
    emulation = Emulation(
        [EmulationRequest(plugin, where, WireFaults(faults))], SharedRig(rig, time.monotonic_ns)
    )
    places = emulation.start()
    try:
        yield places[0]
    finally:
        emulation.stop()
