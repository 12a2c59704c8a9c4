"""The conversation with LabJack T4, T7 and T8: one request per cycle (function 0x4C)."""

from collections.abc import Sequence
from math import inf, nan
from struct import Struct
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.modbus.codec import FEEDBACK, ModbusRequest
from piezod_drivers.modbus.layout import armed_watchdogs, profile_of
from piezod_drivers.modbus.options import ModbusOptions
from piezod_drivers.modbus.player import LabJackPlayer
from piezod_drivers.modbus.profiles.labjack import COUNTER_10KHZ
from piezod_drivers.modbus.profiles.labjack_stream import STREAM_PLANS
from piezod_drivers.modbus.register import Register, Role
from piezod_drivers.modbus.setup import DeviceSetup
from piezod_drivers.modbus.stream_setup import StreamSetup
from piezod_drivers.modbus.transactions import Transactions

_PART: Final = Struct(">BHB")
"""Header of a part of a request: 0 to read or 1 to write, address, number of registers."""
_ECHO: Final = bytes((FEEDBACK,))
_WRAPS_AT: Final = 1 << 32
_NEAR_V: Final = 0.02
"""Largest distance from the safe voltage at which an output counts as safe; it covers the coarsest
converter.
"""


class LabJackDialogue(BaseDialogue):
    """Implements `ExchangingDialogue`.

    Each request reads the outputs before and after it sets them. This shows whether the watchdog
    has tripped, or whether another program drives the outputs. It also reads a counter, which
    restarts at 0 after a reset. After a silence in which the watchdog may have tripped, the outputs
    are read before anything is set. If it has tripped, nothing is set until the device was opened
    again and its outputs were taken over at their present values. A watchdog is armed only if
    outputs are in use.

    Args:
        stream: The line from which the packets of a play come.

    Attributes:
        player: Plays tables on the outputs.
    """

    def __init__(
        self, options: ModbusOptions, wiring: Wiring, transactions: Transactions, stream: Line
    ) -> None:
        super().__init__(wiring, transactions, transactions)
        profile = profile_of(options)
        assert profile is not None  # noqa: S101 - `make_device` has checked it
        self._profile, self._options, self._transactions = profile, options, transactions
        plans = [plan for _, plan in armed_watchdogs(options, wiring)]
        self._watchdog = plans[0] if plans else None
        wanted = options.watchdog if plans else None
        self._safe_v = wanted.safe if wanted else nan
        # 0.9 is a margin: after this silence the watchdog may trip before the next request arrives.
        self._silence_ns = round(0.9e9 * wanted.timeout_s) if wanted else inf
        inputs = [_register(options.known, "input", name) for name in wiring.inputs]
        self._outputs = [_register(options.known, "output", name) for name in wiring.outputs]
        self._n_outputs = n = len(self._outputs)
        self._ranges = [(register.low, register.high) for register in self._outputs]
        self._input_ranges = [(register.low, register.high) for register in inputs]
        before = [register.address for register in self._outputs]
        self._head = _ECHO + _reads(before)
        self._write_heads = [_PART.pack(1, address, 2) for address in before]
        measured = [register.address for register in inputs]
        self._tail = _reads([*before, *measured, COUNTER_10KHZ])
        # The parts are packed in one call; only the values change from cycle to cycle.
        layout = f">{len(self._head)}s" + n * f"{_PART.size}sf" + f"{len(self._tail)}s"
        self._pack_request = Struct(layout).pack
        # The reply: function, outputs before and after, inputs, counter.
        numbers = Struct(f">B{2 * n + len(inputs)}fI")
        self._unpack, self._reply_bytes = numbers.unpack, numbers.size
        self._values: Sequence[float] = ()
        self._last_ns = self._counter = 0
        self._changed: DeviceFlag | None = None
        self._in_control = False
        self.player = LabJackPlayer(
            StreamSetup(transactions, options.unit, STREAM_PLANS[profile.name]),
            stream,
            wiring,
            options.known,
            self._take_outputs,
        )

    def open(self) -> Identity:
        """Connect, check the order of words, identify the device and read everything once.

        Raises:
            DeviceError: If it is another device.
        """
        self._transactions.open()
        setup = DeviceSetup(self._transactions, self._options.unit)
        setup.check_constants(self._profile, {*self._wiring.inputs, *self._wiring.outputs})
        identity = setup.read_identity(self._profile)
        # The first reply has no earlier outputs to be compared with.
        self._keep_in_force((), None)
        # During a stream the inputs cannot be read; `activate` stops it, if it drives our outputs.
        if not self.player.setup.is_active():
            self._read_all()
        return identity

    def capabilities(self) -> Capabilities:
        """Return the channels and the highest rate of the device."""
        return Capabilities(
            self._wiring.inputs,
            self._wiring.outputs,
            read_back=self._n_outputs > 0,
            max_rate_hz=self._profile.max_rate_hz,
            holds=True,
            watchdog=self._watchdog is not None,
            quality=True,
        )

    def activate(self) -> None:
        """Stop a play that is found, and arm the watchdog; the outputs keep their values.

        Raises:
            DeviceError: If it cannot be armed, or a stream of another program is running.
        """
        if self.player.stop_found():
            self._in_force = ()
        self._last_ns = self._transactions.now_ns()
        if self._watchdog is not None and self._options.watchdog is not None:
            setup, wanted = (
                DeviceSetup(self._transactions, self._options.unit),
                self._options.watchdog,
            )
            try:
                setup.arm(self._watchdog, wanted.timeout_s, wanted.safe)
            except DeviceError:
                self._noticed.add(DeviceFlag.WATCHDOG_TRIPPED)
                raise
        self._in_control = True

    def deactivate(self) -> None:
        """Stop the watchdog, if it was armed; the outputs hold."""
        if self._watchdog is not None:
            DeviceSetup(self._transactions, self._options.unit).disarm(self._watchdog)

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe."""
        self._read_all()
        self._in_force_ns = now_ns
        return now_ns, self._values

    def put(self, values: Sequence[float]) -> None:
        """Set every output. Real-time safe."""
        self._forget_in_force()
        self._set(values)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set every output and read every input in one request. Real-time safe."""
        self._forget_in_force()
        self._set(values)
        self._in_force_ns = now_ns
        return now_ns, self._values

    def _ask_in_force(self) -> Sequence[float]:
        self._read_all()
        return self._in_force

    def _take_outputs(self, values: Sequence[float]) -> None:
        """Take the outputs after a play as the ones that are in force. Real-time safe."""
        self._keep_in_force(tuple(values), None)
        self._last_ns = self._transactions.now_ns()

    def _set(self, values: Sequence[float]) -> None:
        if self._transactions.now_ns() - self._last_ns > self._silence_ns:
            self._read_all()
            # Any change during the silence counts, also one by another program.
            self._in_control &= self._changed is None
        if not self._in_control:
            what = (
                "the outputs changed during a pause in communication and must be taken over again"
            )
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self._profile.name}: {what}")
        parts: list[object] = [self._head]
        for head, value in zip(self._write_heads, values, strict=True):
            parts += (head, value)
        self._ask(self._pack_request(*parts, self._tail))

    def _read_all(self) -> None:
        self._ask(self._head + self._tail)

    def _ask(self, pdu: bytes) -> None:
        """Send a request; keep the outputs, the inputs and the counter of its reply."""
        request, asked_ns = (
            ModbusRequest(pdu, _ECHO, self._reply_bytes),
            self._transactions.now_ns(),
        )
        numbers = self._unpack(self._transactions.ask(self._options.unit, (request,)))
        n, counter = self._n_outputs, numbers[-1]
        self._changed = None
        if counter < self._counter or numbers[1 : 1 + n] != self._in_force:
            self._note_change(numbers[1 : 1 + n], counter)
        self._counter, self._in_force = counter, numbers[1 + n : 1 + 2 * n]
        # The instant of the request, not of the reply: the watchdog's time runs from there.
        self._last_ns = asked_ns
        self._values = [
            value if low <= value <= high else nan
            for value, (low, high) in zip(numbers[1 + 2 * n : -1], self._input_ranges, strict=True)
        ]
        self._flag_saturated(self._values)

    def _note_change(self, before: Sequence[float], counter: int) -> None:
        """Note the cause if the outputs have changed since the last request."""
        # A counter that goes back means a restart, unless it was about to overflow (after 5 days).
        if counter < self._counter < 0.99 * _WRAPS_AT:
            self._changed = DeviceFlag.RESTARTED
        elif self._in_force and before != self._in_force:
            # Outputs at the safe voltage were set by the watchdog, other changes by another
            # program.
            safe = all(abs(value - self._safe_v) < _NEAR_V for value in before)
            self._changed = DeviceFlag.WATCHDOG_TRIPPED if safe else DeviceFlag.LOCAL_MODE
            # Setting an output after a trip would be a jump; after a change by another program, the
            # setpoints go on.
            self._in_control &= not safe
        if self._changed is not None:
            self._noticed.add(self._changed)


def _reads(addresses: Sequence[int]) -> bytes:
    return b"".join([_PART.pack(0, address, 2) for address in addresses])


def _register(known: Sequence[Register], role: Role, name: str) -> Register:
    return next(reg for reg in known if reg.role == role and reg.channel == name)
