"""Emulated LabJack T4, T7 and T8."""

from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple
from zlib import crc32

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.modbus.emulation.converter import ConverterOutput, measured_v
from piezod_drivers.modbus.emulation.digital_outputs import DigitalOutputs
from piezod_drivers.modbus.emulation.flash import Flash
from piezod_drivers.modbus.emulation.servers import TcpServer
from piezod_drivers.modbus.emulation.stream import Stream
from piezod_drivers.modbus.emulation.stream_out import add_stream_outs
from piezod_drivers.modbus.emulation.unit import (
    DEVICE_FAILURE,
    FEEDBACK,
    EmulatedUnit,
    ModbusRefusal,
)
from piezod_drivers.modbus.emulation.watchdog import RUNNING, Watchdog
from piezod_drivers.modbus.profiles import labjack
from piezod_drivers.modbus.profiles.labjack_stream import (
    DIO_STATE,
    IS_ACTIVE,
    LAST_ERROR,
    STREAM_PLANS,
)
from piezod_drivers.modbus.register import Table

FUNCTIONS: Final = frozenset({3, 4, 6, 16, FEEDBACK})
_INVALID_V: Final = -9999.0
_RANGE_V: Final = 10.1
_LOW_RANGE_V: Final = 2.5
_WRAPS_AT: Final = 1 << 32
DAC: Final = 1000
"""Address of the first output."""


class LabJackModel(NamedTuple):
    """Properties in which the models differ."""

    product: int  #: Number of the product.
    n_inputs: int  #: Number of inputs.
    n_low_inputs: int  #: Number of them, the last ones, whose range is 0 to 2.5 V.
    highest_v: float  #: Highest voltage of the outputs, in V.
    n_codes: int  #: Number of steps of the outputs.
    usual_serial: int  #: Serial number if no other is given.


T4: Final = LabJackModel(4, 12, 8, 5.0, (1 << 10) - 1, 440_010_001)
T7: Final = LabJackModel(7, 14, 0, 5.0, (1 << 12) - 1, 470_010_001)
T8: Final = LabJackModel(8, 8, 0, 10.0, (1 << 16) - 1, 480_010_001)


class LabJackServer(TcpServer):
    """A LabJack: implements `Emulator` for its requests, and `Streams`.

    Args:
        on_request: Called with True for each request, and with False by `due`.

    Attributes:
        lines: The digital outputs.
        pulses: Number of pulses of each of them.
    """

    def __init__(
        self,
        unit: EmulatedUnit,
        on_request: Callable[[bool], None],
        stream: Stream,
        lines: DigitalOutputs,
    ) -> None:
        super().__init__(unit, on_request)
        self._stream = stream
        self.lines, self.pulses = lines, lines.pulses

    def receive(self, data: bytes) -> list[bytes]:
        """Make all scans that are due, then reply to every complete request."""
        self._stream.advance()
        return super().receive(data)

    def due(self) -> list[bytes]:
        """Send nothing; make all scans that are due, and let time pass for the watchdog."""
        self._stream.advance()
        return super().due()

    def stream_connected(self) -> None:
        """Start with a whole packet."""
        self._stream.start_packet()

    def stream_waiting(self) -> bytes:
        """Return the rest of the packet that is being sent."""
        return self._stream.waiting()

    def stream_sent(self, n_bytes: int) -> None:
        """Drop bytes that were sent."""
        self._stream.sent(n_bytes)


def emulator(model: LabJackModel, bench: SharedRig, serial: str) -> LabJackServer:
    """Construct a LabJack: input and output i are sensor and amplifier of axis i."""
    unit = EmulatedUnit(FUNCTIONS)
    outputs = [ConverterOutput(bench, axis, model.highest_v, model.n_codes) for axis in range(2)]
    plan = STREAM_PLANS[f"labjack-t{model.product}"]
    flash = Flash(plan, model.n_inputs)
    targets = {DAC + 2 * i: output for i, output in enumerate(outputs)}
    lines = DigitalOutputs()
    driven: dict[int, ConverterOutput | DigitalOutputs] = {**targets, DIO_STATE: lines}
    stream = Stream(bench, plan, driven, model.n_inputs, flash.encode)
    for i in range(model.n_inputs):
        is_low = i >= model.n_inputs - model.n_low_inputs
        value_v = partial(_unless_streaming, stream, (_low_input if is_low else _input)(bench, i))
        unit.add("holding", 2 * i, "float32", value_v)
        unit.add("input", 2 * i, "float32", value_v)
    for address, output in targets.items():
        unit.add("holding", address, "float32", _value_of(output), output.set)
    unit.add("holding", LAST_ERROR, "uint16", lambda: unit.last_error)
    unit.add("holding", LAST_ERROR + 1, "uint16", lambda: unit.last_exception)
    _add_identity(unit, model, bench, serial)
    flash.add_to(unit)
    lines.add_to(unit)
    stream.add_to(unit)
    add_stream_outs(unit, stream.outs)
    return LabJackServer(unit, _watchdog(unit, bench, outputs).update, stream, lines)


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


def _unless_streaming(stream: Stream, value_v: Callable[[], float]) -> float:
    """Read an input by a command, which a stream makes impossible."""
    if stream.active:
        raise ModbusRefusal(DEVICE_FAILURE, IS_ACTIVE)
    return value_v()


def _input(bench: SharedRig, axis: int) -> Callable[[], float]:
    def value_v() -> float:
        value = measured_v(bench, axis)
        return value if abs(value) <= _RANGE_V else _INVALID_V

    return value_v


def _low_input(bench: SharedRig, axis: int) -> Callable[[], float]:
    return lambda: min(max(measured_v(bench, axis), 0.0), _LOW_RANGE_V)


def _value_of(output: ConverterOutput) -> Callable[[], float]:
    return lambda: output.value
