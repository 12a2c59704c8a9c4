"""Emulated LabJack T4, T7 and T8."""

from collections.abc import Callable
from typing import Final, NamedTuple
from zlib import crc32

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.modbus.codec import FEEDBACK
from piezod_drivers.modbus.emulation.converter import ConverterOutput, measured_v
from piezod_drivers.modbus.emulation.servers import TcpServer
from piezod_drivers.modbus.emulation.unit import EmulatedUnit
from piezod_drivers.modbus.emulation.watchdog import RUNNING, Watchdog
from piezod_drivers.modbus.profiles import labjack
from piezod_drivers.modbus.register import Table

FUNCTIONS: Final = frozenset({3, 4, 6, 16, FEEDBACK})
_INVALID_V: Final = -9999.0
_RANGE_V: Final = 10.1
_LOW_RANGE_V: Final = 2.5
_WRAPS_AT: Final = 1 << 32


class LabJackModel(NamedTuple):
    """Properties in which the models differ.

    Attributes:
        product: Number of the product.
        n_inputs: Number of inputs.
        n_low_inputs: Number of them, the last ones, whose range is 0 to 2.5 V.
        highest_v: Highest voltage of the outputs, in V.
        n_codes: Number of steps of the outputs.
        usual_serial: Serial number if no other is given.
    """

    product: int
    n_inputs: int
    n_low_inputs: int
    highest_v: float
    n_codes: int
    usual_serial: int


T4: Final = LabJackModel(4, 12, 8, 5.0, (1 << 10) - 1, 440_010_001)
T7: Final = LabJackModel(7, 14, 0, 5.0, (1 << 12) - 1, 470_010_001)
T8: Final = LabJackModel(8, 8, 0, 10.0, (1 << 16) - 1, 480_010_001)


def emulator(model: LabJackModel, bench: SharedRig, serial: str) -> TcpServer:
    """Construct a LabJack: input and output i are sensor and amplifier of axis i."""
    unit = EmulatedUnit(FUNCTIONS)
    outputs = [ConverterOutput(bench, axis, model.highest_v, model.n_codes) for axis in range(2)]
    for i in range(model.n_inputs):
        is_low = i >= model.n_inputs - model.n_low_inputs
        value_v = (_low_input if is_low else _input)(bench, i)
        unit.add("holding", 2 * i, "float32", value_v)
        unit.add("input", 2 * i, "float32", value_v)
    for i, output in enumerate(outputs):
        unit.add("holding", 1000 + 2 * i, "float32", _value_of(output), output.set)
    _add_identity(unit, model, bench, serial)
    watchdog = _watchdog(unit, bench, outputs)
    return TcpServer(unit, watchdog.update)


def _add_identity(unit: EmulatedUnit, model: LabJackModel, bench: SharedRig, serial: str) -> None:
    started_ns = bench.now_ns()
    # The register holds a number; other text gets one that is always the same.
    number = int(serial) if serial.isdigit() else crc32(serial.encode()) % 10**9
    number = number % _WRAPS_AT if serial else model.usual_serial
    tables: tuple[Table, ...] = ("holding", "input")
    for table in tables:
        unit.add(table, labjack.PRODUCT_ID, "float32", lambda: model.product)
        unit.add(table, labjack.FIRMWARE, "float32", lambda: 1.0300)
        unit.add(table, labjack.SERIAL, "uint32", lambda: number)
        unit.add(table, labjack.TEST, "uint32", lambda: labjack.TEST_NUMBER)
        unit.add(
            table,
            labjack.COUNTER_10KHZ,
            "uint32",
            lambda: ((bench.now_ns() - started_ns) // 100_000) % _WRAPS_AT,
        )


def _watchdog(unit: EmulatedUnit, bench: SharedRig, outputs: list[ConverterOutput]) -> Watchdog:
    timeout_s = unit.add_stored("holding", labjack.WATCHDOG_TIMEOUT_S, "uint32", 3600)
    safe = [
        (
            unit.add_stored("holding", enable, "uint32"),
            unit.add_stored("holding", value, "float32"),
            output,
        )
        for (enable, value), output in zip(labjack.WATCHDOG_DACS, outputs, strict=True)
    ]

    def on_trip() -> None:
        for enabled, value, output in safe:
            if enabled():
                output.set(value())
        watchdog.start()  # it keeps running and can trip again

    watchdog = Watchdog(bench.now_ns, timeout_s, on_trip)
    unit.add(
        "holding",
        labjack.WATCHDOG_ENABLE,
        "uint32",
        lambda: watchdog.state == RUNNING,
        lambda on: watchdog.start() if on else watchdog.stop(),
    )
    return watchdog


def _input(bench: SharedRig, axis: int) -> Callable[[], float]:
    def value_v() -> float:
        value = measured_v(bench, axis)
        return value if abs(value) <= _RANGE_V else _INVALID_V

    return value_v


def _low_input(bench: SharedRig, axis: int) -> Callable[[], float]:
    return lambda: min(max(measured_v(bench, axis), 0.0), _LOW_RANGE_V)


def _value_of(output: ConverterOutput) -> Callable[[], float]:
    return lambda: output.value
