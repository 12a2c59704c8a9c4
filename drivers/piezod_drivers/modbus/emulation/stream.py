"""The stream of an emulated LabJack: it scans inputs and writes stream-outs by its own clock."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import UM_PER_V, SharedRig
from piezod.units import NS_PER_S
from piezod_drivers.modbus.emulation.converter import OVERLOAD_V, ConverterOutput
from piezod_drivers.modbus.emulation.digital_outputs import DigitalOutputs
from piezod_drivers.modbus.emulation.stream_buffer import StreamBuffer
from piezod_drivers.modbus.emulation.stream_out import StreamOut
from piezod_drivers.modbus.emulation.unit import DEVICE_FAILURE, EmulatedUnit, ModbusRefusal
from piezod_drivers.modbus.profiles import labjack_stream as registers
from piezod_drivers.modbus.profiles.labjack_stream import StreamPlan
from piezod_drivers.modbus.register import NumberType

EncodeInput = Callable[[int, float], int]
"""Returns the code of an input for a voltage."""

_TICKS_HZ: Final = 10_000_000
"""The core clock of 80 MHz divided by 8."""
_DEFAULT_BUFFER: Final = 4096
_MOST_BUFFER: Final = 32_768
_EMPTY, _CONFIG, _CHANNEL, _RATE, _TARGET, _SIZE, _PACKET = 2600, 2606, 2607, 2608, 2612, 2615, 2618
_MOST_RESOLUTION: Final = 8
_NOTHING: Final = StreamBuffer(0, 1)
_OUTS: Final = range(registers.OUT_IN_SCAN, registers.OUT_IN_SCAN + registers.N_OUTS)


class Stream:
    """The registers of the stream, and its scans.

    In each scan the inputs are sampled first; then each stream-out of the list gives its next value
    to its output. The first scan comes one interval after the start.

    Args:
        plan: Limits of the device.
        outputs: Each output by its address.
        n_inputs: Number of inputs.
        encode: Code of an input.
    """

    def __init__(
        self,
        bench: SharedRig,
        plan: StreamPlan,
        outputs: Mapping[int, ConverterOutput | DigitalOutputs],
        n_inputs: int,
        encode: EncodeInput,
    ) -> None:
        self._bench, self._plan, self._outputs = bench, plan, outputs
        self._n_inputs, self._encode = n_inputs, encode
        self.outs = [StreamOut(outputs) for _ in range(registers.N_OUTS)]
        self._interval_ns, self._next_ns, self._scans_left = 0, 0, 0
        self._buffer, self._waiting = _NOTHING, b""
        self._settings: dict[int, Callable[[], float]] = {}
        self._channels: list[int] = []
        self.active = False
        bench.plays_from(None)

    def add_to(self, unit: EmulatedUnit) -> None:
        """Add the registers."""
        unit.add("holding", registers.SCAN_RATE_HZ, "float32", self._rate_hz, self._set_rate)
        settings: list[tuple[int, NumberType]] = [
            (registers.N_ADDRESSES, "uint32"),
            (registers.SAMPLES_PER_PACKET, "uint32"),
            (registers.SETTLING_US, "float32"),
            (registers.RESOLUTION_INDEX, "uint32"),
            (registers.BUFFER_BYTES, "uint32"),
            (registers.AUTO_TARGET, "uint32"),
            (registers.DATA_TYPE, "uint32"),
            (registers.CLOCK_SOURCE, "uint32"),
            (registers.TRIGGER_INDEX, "uint32"),
            (registers.N_SCANS, "uint32"),
            *((registers.SCAN_LIST + 2 * i, "uint32") for i in range(registers.MOST_ADDRESSES)),
        ]
        for address, kind in settings:
            self._settings[address] = unit.add_stored("holding", address, kind)
        unit.add("holding", registers.ENABLE, "uint32", lambda: self.active, self._set_enabled)

    def advance(self) -> None:
        """Make all scans that are due."""
        now_ns = self._bench.now_ns()
        while self.active and self._next_ns <= now_ns:
            self._scan(self._next_ns)
            self._next_ns += self._interval_ns
        if self.active:
            self._bench.plays_from(self._next_ns)

    def waiting(self) -> bytes:
        """Return the rest of the packet that is being sent."""
        self._waiting = self._waiting or self._buffer.packet()
        return self._waiting

    def sent(self, n_bytes: int) -> None:
        """Drop bytes that were sent."""
        self._waiting = self._waiting[n_bytes:]

    def start_packet(self) -> None:
        """Drop the rest of a packet that an earlier client has not received."""
        self._waiting = b""

    def _setting(self, address: int) -> int:
        return int(self._settings[address]())

    def _rate_hz(self) -> float:
        return NS_PER_S / self._interval_ns if self._interval_ns else 0.0

    def _set_rate(self, rate_hz: float) -> None:
        self._require_inactive()
        if not (isfinite(rate_hz) and rate_hz > 0):
            raise ModbusRefusal(DEVICE_FAILURE, _RATE)
        # The device cuts the fraction off: a rate that is a little too high shortens the interval.
        self._interval_ns = max(int(_TICKS_HZ / rate_hz), 1) * registers.TICK_NS

    def _require_inactive(self) -> None:
        if self.active:
            raise ModbusRefusal(DEVICE_FAILURE, registers.IS_ACTIVE)

    def _set_enabled(self, on: float) -> None:
        self.advance()
        if on:
            self._start()
        elif not self.active:
            raise ModbusRefusal(DEVICE_FAILURE, registers.NOT_RUNNING)
        else:
            self._stop()

    def _start(self) -> None:
        self._require_inactive()
        self._channels = self._checked_channels()
        per_packet = self._setting(registers.SAMPLES_PER_PACKET)
        if not 1 <= per_packet <= registers.MOST_SAMPLES:
            raise ModbusRefusal(DEVICE_FAILURE, _PACKET)
        if self._setting(registers.AUTO_TARGET) != registers.ETHERNET:
            raise ModbusRefusal(DEVICE_FAILURE, _TARGET)
        n_bytes = self._setting(registers.BUFFER_BYTES) or _DEFAULT_BUFFER
        if n_bytes > _MOST_BUFFER or n_bytes & (n_bytes - 1):
            raise ModbusRefusal(DEVICE_FAILURE, _SIZE)
        if self._setting(registers.RESOLUTION_INDEX) > _MOST_RESOLUTION:
            raise ModbusRefusal(DEVICE_FAILURE, _CONFIG)
        self._buffer, self._waiting = StreamBuffer(n_bytes // 2, per_packet), b""
        self._scans_left = self._setting(registers.N_SCANS) or -1
        self._next_ns = self._bench.start_ns() + self._interval_ns
        self.active = True
        self._bench.plays_from(self._next_ns)

    def _checked_channels(self) -> list[int]:
        n_channels = self._setting(registers.N_ADDRESSES)
        if not 1 <= n_channels <= registers.MOST_ADDRESSES:
            raise ModbusRefusal(DEVICE_FAILURE, _EMPTY)
        found = [self._setting(registers.SCAN_LIST + 2 * i) for i in range(n_channels)]
        inputs = range(0, 2 * self._n_inputs, 2)
        if any(each not in {*inputs, *_OUTS, registers.SELF_INDEX} for each in found):
            raise ModbusRefusal(DEVICE_FAILURE, _CHANNEL)
        if n_channels * self._plan.address_ns > self._interval_ns:
            raise ModbusRefusal(DEVICE_FAILURE, _RATE)
        return found

    def _stop(self, status: int = 0) -> None:
        self.active = False
        self._bench.plays_from(None)
        if status:
            self._buffer.end(status)

    def _scan(self, t_ns: int) -> None:
        outs = [each for each in self._channels if each in _OUTS]
        n_samples = len(self._channels) - len(outs)
        self._sample(t_ns, n_samples)
        # The inputs come first, so the outputs follow by the time that the inputs need.
        t_ns += n_samples * self._plan.address_ns
        for address in outs:
            out = self.outs[address - registers.OUT_IN_SCAN]
            value = out.next_value() if out.enabled else None
            if value is not None:
                with suppress(ModbusRefusal):  # the amplifier behind it cannot give this voltage
                    self._outputs[out.target].set(value, t_ns)
        settling_ns = self._settings[registers.SETTLING_US]() * 1e3
        if len(self._channels) * (self._plan.address_ns + settling_ns) > self._interval_ns:
            self._stop(registers.OVERLAP)
            return
        self._scans_left -= 1
        if self._scans_left == 0:
            self._stop(registers.COMPLETE)

    def _sample(self, t_ns: int, n_samples: int) -> None:
        if not n_samples:
            return
        positions_um: Sequence[float] = self._bench.positions_um(t_ns)
        codes = []
        for i, address in enumerate(self._channels):
            if address == registers.SELF_INDEX:
                codes.append(i)
            elif address not in _OUTS:
                axis = address // 2
                value_v = positions_um[axis] / UM_PER_V if axis < self._bench.n_axes else 0.0
                codes.append(self._encode(axis, value_v if isfinite(value_v) else OVERLOAD_V))
        self._buffer.add(codes)
