"""Sets up the stream of a LabJack: its stream-outs, its scan list, the scale of its inputs."""

from collections.abc import Sequence
from struct import Struct, pack, unpack
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.player import Check
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.modbus.codec import ModbusRequest, WriteMany, read
from piezod_drivers.modbus.profiles import labjack_stream as registers
from piezod_drivers.modbus.profiles.labjack_stream import InputScale, StreamPlan, input_scale
from piezod_drivers.modbus.register import STRUCTS, NumberType
from piezod_drivers.modbus.transactions import Transactions

_PER_REQUEST: Final = 60
"""Number of FLOAT32 values in a request of function 16."""
_BUFFER_BYTES: Final = 32_768
"""Size of the buffer of samples: the largest one, or the device's own choice if it refuses it."""
_FLOAT: Final = Struct(">f")
_REFUSALS: Final = frozenset({DeviceFlag.WRONG_REQUEST, DeviceFlag.DEVICE_FAILURE, DeviceFlag.BUSY})


class StreamSetup:
    """Reads and writes the registers of a stream. Not real-time safe.

    Args:
        unit: Address of the device.

    Attributes:
        plan: Properties of its stream.

    Raises:
        LineFault: If the line is lost.
        DeviceError: If the device refuses; the text has its own error.
    """

    def __init__(self, transactions: Transactions, unit: int, plan: StreamPlan) -> None:
        self._transactions, self._unit, self.plan = transactions, unit, plan

    def ask(self, request: ModbusRequest) -> bytes:
        """Send a request and return its reply. Real-time safe.

        Raises:
            LineFault: If there is no reply in time, or the device refuses.
        """
        return self._transactions.ask(self._unit, (request,))

    def number(self, address: int, kind: NumberType = "uint32") -> float:
        """Return the number in a register."""
        layout = STRUCTS[kind]
        pdu = self._read(address, layout.size // 2)
        return float(layout.unpack_from(pdu, 2)[0])

    def write(self, address: int, number: float, kind: NumberType = "uint32") -> None:
        """Write a number."""
        self._write(address, STRUCTS[kind].pack(number if kind == "float32" else int(number)))

    def is_active(self) -> bool:
        """Return whether a stream is running."""
        return bool(self.number(registers.ENABLE))

    def played_outputs(self) -> set[int]:
        """Return the addresses of the outputs that the running stream drives."""
        n_channels = int(self.number(registers.N_ADDRESSES))
        played = set()
        for i in range(min(n_channels, registers.MOST_ADDRESSES)):
            out = int(self.number(registers.SCAN_LIST + 2 * i)) - registers.OUT_IN_SCAN
            if 0 <= out < registers.N_OUTS:
                played.add(int(self.number(registers.OUT_TARGET + registers.OUT_STEP * out)))
        return played

    def stop(self) -> None:
        """Stop the stream; the outputs hold. Nothing happens if none is running."""
        try:
            self.ask(WriteMany(registers.ENABLE, 2).request(STRUCTS["uint32"].pack(0)))
        except LineFault as fault:
            if fault.flag not in _REFUSALS or self._last_error() != registers.NOT_RUNNING:
                raise

    def load(
        self,
        out: int,
        target: int,
        values: Sequence[float],
        n_looped: int,
        check: Check,
        *,
        words: bool = False,
    ) -> None:
        """Give a stream-out its values, from the first one on.

        The values are played once, then the last ones are repeated.

        Args:
            out: Number of the stream-out.
            target: Address of its output.
            values: The values, in V.
            n_looped: How many of them are repeated.
            check: Called between two exchanges.
            words: Whether they are whole numbers of 16 bits.

        Raises:
            DeviceError: If the device does not hold them afterwards.
        """
        step = registers.OUT_STEP * out
        # Without this a stream-out goes on where an earlier stream has stopped.
        self.write(registers.OUT_ENABLE + step, 0)
        self.write(registers.OUT_TARGET + step, target)
        self.write(registers.OUT_BYTES + step, registers.OUT_MOST_BYTES)
        # Values before this are refused: error 2627.
        self.write(registers.OUT_ENABLE + step, 1)
        self.write(registers.OUT_LOOP_VALUES + step, n_looped)
        letter, register = ("H", registers.OUT_WORDS) if words else ("f", registers.OUT_VALUES)
        for first in range(0, len(values), _PER_REQUEST):
            check()
            part = values[first : first + _PER_REQUEST]
            self._write(register + step, pack(f">{len(part)}{letter}", *part))
        self.write(registers.OUT_SET_LOOP + step, 1)
        self._check_loaded(step, target, len(values), n_looped)

    def make_outputs(self, mask: int) -> None:
        """Make the lines FIO0 to FIO7 with these bits outputs, and low."""
        for register in (registers.DIO_DIRECTION, registers.DIO_STATE):
            state = mask if register == registers.DIO_DIRECTION else 0
            self._write(register, pack(">H", dio_word(state, mask)))

    def configure(
        self, interval_ns: int, channels: Sequence[int], n_inputs: int, n_scans: int
    ) -> None:
        """Set up the scans.

        Args:
            interval_ns: Time between two scans, in ns.
            channels: The scan list.
            n_inputs: Number of its channels that return a sample.
            n_scans: Number of scans after which the stream ends.

        Raises:
            DeviceError: If the device has another interval.
        """
        for address in (
            (registers.CLOCK_SOURCE, registers.TRIGGER_INDEX) if self.plan.has_trigger else ()
        ):
            self.write(address, 0)
        self.write(registers.SCAN_RATE_HZ, _rate_hz(interval_ns), "float32")
        self.write(registers.N_ADDRESSES, len(channels))
        self.write(registers.SAMPLES_PER_PACKET, _per_packet(interval_ns, n_inputs))
        self.write(registers.SETTLING_US, 0, "float32")
        self.write(registers.RESOLUTION_INDEX, 0)
        self.write(registers.BUFFER_BYTES, _BUFFER_BYTES)
        self.write(registers.AUTO_TARGET, registers.ETHERNET)
        self.write(registers.DATA_TYPE, 0)
        self.write(registers.N_SCANS, n_scans)
        for i, channel in enumerate(channels):
            self.write(registers.SCAN_LIST + 2 * i, channel)
        actual_ns = NS_PER_S / self.number(registers.SCAN_RATE_HZ, "float32")
        if abs(actual_ns - interval_ns) > registers.TICK_NS / 2:
            raise DeviceError(f"the device scans every {actual_ns:.0f} ns instead of {interval_ns}")

    def scale(self, channel: int) -> InputScale:
        """Return the scale of an input in its present range, from the flash memory.

        Raises:
            DeviceError: If its range is unknown, or the memory holds no scale.
        """
        range_v = self.number(registers.AIN_RANGE + 2 * channel, "float32")
        source = self.plan.scale_source(channel, range_v)
        if source is None:
            raise DeviceError(f"AIN{channel} has the unknown range {range_v:g} V")
        self.write(registers.FLASH_POINTER, source.address)
        pdu = self._read(registers.FLASH_READ, 2 * source.n_floats)
        scale = input_scale(unpack(f">{source.n_floats}f", pdu[2:]))
        # Erased memory reads as NaN.
        if not (1e-9 < scale.above < 1e-2 and 1e-9 < scale.below < 1e-2):
            raise DeviceError(f"the flash memory has no scale of AIN{channel}: {scale}")
        return scale

    def _check_loaded(self, step: int, target: int, n_values: int, n_looped: int) -> None:
        free_bytes = self.number(registers.OUT_FREE_BYTES + step)
        room = registers.OUT_MOST_BYTES - 2
        # Not confirmed whether this register counts the free bytes or the used ones.
        held = (
            free_bytes in {room - 2 * n_values, 2 * n_values}
            and self.number(registers.OUT_ENABLE + step) == 1
            and self.number(registers.OUT_TARGET + step) == target
            and self.number(registers.OUT_LOOP_VALUES + step) == n_looped
        )
        if not held:
            raise DeviceError(
                f"the device does not hold the {n_values} values that it got: "
                f"{free_bytes:.0f} of {room} bytes are free"
            )

    def _read(self, address: int, n_words: int) -> bytes:
        try:
            return self.ask(read("holding", address, n_words))
        except LineFault as fault:
            raise self._error(fault, address) from fault

    def _write(self, address: int, words: bytes) -> None:
        try:
            self.ask(WriteMany(address, len(words) // 2).request(words))
        except LineFault as fault:
            raise self._error(fault, address) from fault

    def _error(self, fault: LineFault, address: int) -> Exception:
        """Return the device's own error if it has refused, else the fault."""
        if fault.flag not in _REFUSALS:
            return fault
        code = self._last_error()
        what = registers.ERRORS.get(code, "unknown to piezod")
        return DeviceError(f"the device refuses register {address}: error {code}, {what}")

    def _last_error(self) -> int:
        pdu = self.ask(read("holding", registers.LAST_ERROR, 1))
        return int.from_bytes(pdu[2:4], "big")


def dio_word(state: int, mask: int) -> int:
    """Return the word that sets the lines of a mask and leaves all others alone."""
    return (~mask & 0xFF) << 8 | state & mask


def _rate_hz(interval_ns: int) -> float:
    """Return the highest FLOAT32 rate whose interval is not shorter, in Hz.

    The device cuts its number of ticks off, so a rate that is a little too high would shorten the
    interval by one of them.
    """
    rate_hz = float(_FLOAT.unpack(_FLOAT.pack(NS_PER_S / interval_ns))[0])
    if rate_hz * interval_ns > NS_PER_S:
        (bits,) = unpack(">I", _FLOAT.pack(rate_hz))
        rate_hz = float(_FLOAT.unpack(pack(">I", bits - 1))[0])
    return rate_hz


def _per_packet(interval_ns: int, n_inputs: int) -> int:
    """Return the number of samples in a packet: whole scans, about 100 packets a second."""
    n_scans = max(NS_PER_S // 100 // interval_ns, 1)
    most = registers.MOST_SAMPLES // max(n_inputs, 1)
    return int(min(n_scans, most)) * max(n_inputs, 1)
