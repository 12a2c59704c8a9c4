"""The driver `modbus`: chooses line, transactions and dialogue of a device."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.bus.line import Line
from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.modbus.labjack_dialogue import LabJackDialogue
from piezod_drivers.modbus.layout import profile_of
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.profiles.labjack_stream import PORT_DISTANCE
from piezod_drivers.modbus.register_dialogue import RegisterDialogue
from piezod_drivers.modbus.rtu_transactions import RtuTransactions
from piezod_drivers.modbus.tcp_transactions import TcpTransactions
from piezod_drivers.modbus.transactions import Transactions


def make_transactions(options: ModbusOptions) -> Transactions:
    """Construct the line and the transactions of the options; nothing is opened."""
    timeout_s = options.timeout_ms * 1e-3
    if options.host is not None:
        return TcpTransactions(TcpLine(options.host, options.tcp_port), timeout_s)
    assert options.port is not None  # noqa: S101 - the model has checked it
    line = SerialLine(
        options.port,
        options.baud,
        parity=options.parity,
        stop_bits=options.stop_bits,
        settle_s=options.settle_ms * 1e-3,
    )
    units = [unit.unit for unit in options.every_unit]
    return RtuTransactions(line, timeout_s, units, options.silence_s)


def make_device(
    options: ModbusOptions,
    wiring: Wiring,
    transactions: Transactions,
    stream: Line | None = None,
) -> BusDevice:
    """Construct the device of the options.

    Args:
        options: The options.
        wiring: The channels in use.
        transactions: The line.
        stream: The line from which the stream of a LabJack comes; None for its second port.
    """
    profile = profile_of(options)
    name = " + ".join(unit.profile or f"unit {unit.unit}" for unit in options.every_unit)
    if profile is not None and profile.feedback and not options.units:
        if stream is None:
            stream = TcpLine(options.host or "", options.tcp_port + PORT_DISTANCE)
        labjack = LabJackDialogue(options, wiring, transactions, stream)
        if wiring.outputs:
            return ExchangingPlayingBusDevice(name, labjack, labjack.player)
        return ExchangingBusDevice(name, labjack)
    dialogue = RegisterDialogue(options, wiring, transactions)
    return (ExchangingBusDevice if dialogue.exchanges else BusDevice)(name, dialogue)


def channels_of(options: ModbusOptions) -> ChannelUnits:
    """Return the channels of all devices, with their units."""
    known = [register for unit in options.every_unit for register in unit.known]
    inputs, outputs = (
        {reg.channel: reg.unit for reg in known if reg.role == role and reg.channel}
        for role in ("input", "output")
    )
    return ChannelUnits(inputs, outputs)


def _create(options: ModbusOptions, wiring: Wiring, _seed: int) -> BusDevice:
    return make_device(options, wiring, make_transactions(options))


PLUGIN: Final = DriverPlugin(
    name="modbus",
    summary="converters on Modbus TCP or RTU: LabJack T4/T7/T8, ADAM, ICP DAS, WAGO 750, "
    "Waveshare, or any register map",
    options_model=ModbusOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels_of,
    sees=faults("A1 A2 A3 A7 A8 A9 A12 B1 B2 B3 B4 B5 B6 B7 B10 B13 B14 S7 S10"),
)
