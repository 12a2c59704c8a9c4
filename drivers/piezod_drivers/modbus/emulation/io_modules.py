"""Emulated ADAM-6024 and ADAM-4024, M-7017 and M-7024R, WAGO 750, Waveshare AI and AO (B)."""

from functools import partial
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.modbus.emulation.converter import ConverterOutput, measured_v
from piezod_drivers.modbus.emulation.servers import RtuServer, TcpServer
from piezod_drivers.modbus.emulation.unit import (
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    EmulatedUnit,
    ModbusRefusal,
)
from piezod_drivers.modbus.emulation.watchdog import TRIPPED, Watchdog
from piezod_drivers.modbus.profiles import advantech, icp_das, wago, waveshare

_HIGHEST_V: Final = 10.0
_MV: Final = 1e-3
_REGISTERS: Final = frozenset({1, 3, 4, 6, 16})


def _measured(bench: SharedRig, axis: int, scale: float, offset: float = 0.0) -> float:
    """Return the code of an input within ±10 V; value = scale · code + offset."""
    value_v = min(max(measured_v(bench, axis), -_HIGHEST_V), _HIGHEST_V)
    return (value_v - offset) / scale


def _output(
    unit: EmulatedUnit, address: int, output: ConverterOutput, scale: float, offset: float = 0.0
) -> None:
    code = partial(_code, output, scale, offset)
    unit.add("holding", address, "uint16", code, output.set_code(scale, offset))


def _code(output: ConverterOutput, scale: float, offset: float = 0.0) -> float:
    return (output.value - offset) / scale


def adam_6024(bench: SharedRig, _serial: str) -> TcpServer:
    """Construct an ADAM-6024: input and output i are sensor and amplifier of axis i."""
    unit = EmulatedUnit(_REGISTERS)
    for i in range(6):
        # 16 bits over ±10 V.
        scale = 20 / 65_535
        unit.add("holding", i, "uint16", partial(_measured, bench, i, scale, -_HIGHEST_V))
        # Status of each input: bit 1 above its range, bit 2 below it.
        unit.add("holding", 20 + i, "uint16", partial(_over_or_under, bench, i))
    for i in range(2):
        output = ConverterOutput(bench, i, _HIGHEST_V, advantech.CODES_12_BIT)
        _output(unit, 10 + i, output, _HIGHEST_V / advantech.CODES_12_BIT)
    return TcpServer(unit)


def _over_or_under(bench: SharedRig, axis: int) -> float:
    value_v = measured_v(bench, axis)
    return 2 if value_v > _HIGHEST_V else 4 if value_v < -_HIGHEST_V else 0


def adam_4024(bench: SharedRig, _serial: str) -> RtuServer:
    """Construct an ADAM-4024 at address 1: output i is the amplifier of axis i.

    Its outputs are of the type -10 to 10 V, for which it has the codes 0 to 4095.
    """
    unit = EmulatedUnit(_REGISTERS)
    for i in range(4):
        output = ConverterOutput(bench, i, _HIGHEST_V, 0xFFF, -_HIGHEST_V)
        _output(unit, i, output, 2 * _HIGHEST_V / 0xFFF, -_HIGHEST_V)
        unit.add_stored("holding", 200 + i, "uint16", 0x32)
    unit.add("holding", advantech.MODULE_NAME, "uint16", lambda: 0x4024)
    unit.add("holding", advantech.VERSION, "uint16", lambda: 0xA200)
    unit.add("holding", advantech.COMM_SAFETY, "uint16", lambda: 0)
    return RtuServer({1: unit}, bench.now_ns)


def icpdas(bench: SharedRig, _serial: str) -> RtuServer:
    """Construct an M-7017 at address 1 and an M-7024R at address 2 on one line."""
    inputs, outputs = EmulatedUnit(_REGISTERS), EmulatedUnit(_REGISTERS)
    inputs.add_stored("holding", 486, "uint16", 0x08)  # range: -10 to 10 V
    for i in range(8):
        inputs.add("input", i, "int16", partial(_measured, bench, i, _MV))
    for i in range(4):
        _output(outputs, i, ConverterOutput(bench, i, _HIGHEST_V, (1 << 14) - 1), _MV)
    outputs.add("coil", icp_das.WATCHDOG_TRIPPED, "uint16", lambda: 0)
    for unit in (inputs, outputs):
        unit.add("coil", icp_das.FORMAT, "uint16", lambda: 1)
        unit.add("holding", icp_das.FIRMWARE, "uint16", lambda: 0x0220)
    return RtuServer({1: inputs, 2: outputs}, bench.now_ns)


def waveshare_b(bench: SharedRig, _serial: str) -> RtuServer:
    """Construct an Analog Input 8CH (B) at address 1 and an Analog Output 8CH (B) at address 2."""
    inputs, outputs = EmulatedUnit(_REGISTERS), EmulatedUnit(_REGISTERS)
    for i in range(8):
        inputs.add("input", i, "uint16", partial(_measured, bench, i, _MV))
        inputs.add_stored("holding", 0x1000 + i, "uint16")  # mode of the input: 0 to 10 V
        _output(outputs, i, ConverterOutput(bench, i, _HIGHEST_V, (1 << 12) - 1), _MV)
    for unit in (inputs, outputs):
        unit.add("holding", waveshare.VERSION, "uint16", lambda: 100)
    return RtuServer({1: inputs, 2: outputs}, bench.now_ns)


def wago_750(bench: SharedRig, _serial: str, item: int | None = 352) -> TcpServer:
    """Construct a coupler with four inputs and four outputs of 10 V.

    Args:
        bench: The rig.
        item: Reported item number; None for a device that reports neither this nor its series.
    """
    unit = EmulatedUnit(_REGISTERS | {23})
    scale = _HIGHEST_V / wago.CODES
    outputs = [ConverterOutput(bench, i, _HIGHEST_V, (1 << 12) - 1) for i in range(4)]
    watchdog = _wago_watchdog(unit, bench, outputs)
    for i, output in enumerate(outputs):
        get = partial(_measured, bench, i, scale)
        # The process image of a coupler: reading from address 0 returns inputs, writing sets
        # outputs.
        unit.add("input", i, "int16", get)
        unit.add("holding", i, "int16", get, partial(_set_unless_tripped, watchdog, output, scale))
        unit.add("holding", wago.READ_BACK + i, "int16", partial(_code, output, scale))
    for i, number in enumerate(wago.CONSTANTS):
        unit.add("holding", wago.CONSTANTS_AT + i, "uint16", partial(float, number))
    unit.add("holding", wago.FIRMWARE, "uint16", lambda: 5.0)
    if item is not None:
        for address, number in ((wago.SERIES, 750), (wago.ITEM, item)):
            unit.add("holding", address, "uint16", partial(float, number))
    return TcpServer(unit, watchdog.update)


def _set_unless_tripped(
    watchdog: Watchdog, output: ConverterOutput, scale: float, code: float
) -> None:
    # After a trip a coupler refuses to set outputs until its watchdog runs again.
    if watchdog.state == TRIPPED:
        raise ModbusRefusal(DEVICE_FAILURE)
    output.set(code * scale)


def _wago_watchdog(
    unit: EmulatedUnit, bench: SharedRig, outputs: list[ConverterOutput]
) -> Watchdog:
    time = unit.add_stored("holding", wago.WATCHDOG_TIME, "uint16", 100)
    unit.add_stored("holding", wago.WATCHDOG_MASK, "uint16")

    def on_trip() -> None:
        for output in outputs:
            output.set(0.0)

    def stop(number: float) -> None:
        # WAGO's manual allows both orders of the bytes.
        if number not in {0xAA55, 0x55AA}:
            raise ModbusRefusal(ILLEGAL_VALUE)
        watchdog.stop()

    # The register counts in units of 100 ms.
    watchdog = Watchdog(bench.now_ns, lambda: time() / 10, on_trip)
    unit.add(
        "holding", wago.WATCHDOG_TRIGGER, "uint16", lambda: 0.0, lambda _number: watchdog.start()
    )
    unit.add("holding", wago.WATCHDOG_STATUS, "uint16", lambda: watchdog.state)
    unit.add("holding", wago.WATCHDOG_STOP, "uint16", lambda: 0.0, stop)
    return watchdog
