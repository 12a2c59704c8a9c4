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
_NO_VALUE: Final = -9999.0
_RANGE_V: Final = 10.1
_LOW_RANGE_V: Final = 2.5
_WRAPS_AT: Final = 1 << 32


class LabJackModel(NamedTuple):
    """What differs.

    Attributes:
        product: Number of the product.
        n_inputs: Number of inputs.
        n_low_inputs: How many of them, the last ones, end at 0 and 2.5 V.
        highest_v: Of the outputs, in V.
        n_codes: Steps of the outputs.
        usual_serial: Serial number unless told otherwise.
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
    """Make one: input and output i are sensor and amplifier of axis i."""
    unit = EmulatedUnit(FUNCTIONS)
    outputs = [ConverterOutput(bench, axis, model.highest_v, model.n_codes) for axis in range(2)]
    for i in range(model.n_inputs):
        is_low = i >= model.n_inputs - model.n_low_inputs
        value_v = (_low_input if is_low else _input)(bench, i)
        unit.has("holding", 2 * i, "float32", value_v)
        unit.has("input", 2 * i, "float32", value_v)
    for i, output in enumerate(outputs):
        unit.has("holding", 1000 + 2 * i, "float32", _value_of(output), output.set)
    _add_facts(unit, model, bench, serial)
    watchdog = _watchdog(unit, bench, outputs)
    return TcpServer(unit, watchdog.heard)


def _add_facts(unit: EmulatedUnit, model: LabJackModel, bench: SharedRig, serial: str) -> None:
    born_ns = bench.now_ns()
    number = int(serial) if serial.isdigit() else crc32(serial.encode()) % 10**9
    number = number % _WRAPS_AT if serial else model.usual_serial
    tables: tuple[Table, ...] = ("holding", "input")
    for table in tables:
        unit.has(table, labjack.PRODUCT_ID, "float32", lambda: model.product)
        unit.has(table, labjack.FIRMWARE, "float32", lambda: 1.0300)
        unit.has(table, labjack.SERIAL, "uint32", lambda: number)
        unit.has(table, labjack.TEST, "uint32", lambda: labjack.TEST_NUMBER)
        unit.has(
            table,
            labjack.COUNTER_10KHZ,
            "uint32",
            lambda: ((bench.now_ns() - born_ns) // 100_000) % _WRAPS_AT,
        )


def _watchdog(unit: EmulatedUnit, bench: SharedRig, outputs: list[ConverterOutput]) -> Watchdog:
    timeout_s = unit.stores("holding", labjack.WATCHDOG_TIMEOUT_S, "uint32", 3600)
    safe = [
        (
            unit.stores("holding", enable, "uint32"),
            unit.stores("holding", value, "float32"),
            output,
        )
        for (enable, value), output in zip(labjack.WATCHDOG_DACS, outputs, strict=True)
    ]

    def trips() -> None:
        for enabled, value, output in safe:
            if enabled():
                output.set(value())
        watchdog.start()  # it goes on, and would do it again

    watchdog = Watchdog(bench.now_ns, timeout_s, trips)
    unit.has(
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
        return value if abs(value) <= _RANGE_V else _NO_VALUE

    return value_v


def _low_input(bench: SharedRig, axis: int) -> Callable[[], float]:
    return lambda: min(max(measured_v(bench, axis), 0.0), _LOW_RANGE_V)


def _value_of(output: ConverterOutput) -> Callable[[], float]:
    return lambda: output.value
