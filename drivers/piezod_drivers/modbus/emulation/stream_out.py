"""The stream-outs of an emulated LabJack: buffers whose values a stream writes to outputs."""

from collections.abc import Callable, Container, Sequence
from functools import partial
from math import isfinite
from struct import calcsize, unpack
from typing import Final

from piezod_drivers.modbus.emulation.unit import (
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    EmulatedUnit,
    ModbusRefusal,
    RegisterPort,
)
from piezod_drivers.modbus.profiles import labjack_stream as registers
from piezod_drivers.modbus.profiles.labjack_stream import OUT_LEAST_BYTES, OUT_MOST_BYTES

USE_NOW, WAIT, SYNCHRONISE = 1, 2, 3
"""Values of the register that takes new values into use."""
_TOO_BIG, _FULL, _WRONG_TARGET, _WRONG_SIZE, _NO_SIZE = 2609, 2613, 2614, 2615, 2617
_LOOP_TOO_BIG, _NOT_ENABLED, _WRONG_VALUE = 2622, 2627, 2606
_BYTES: Final = 2
"""Bytes of each value."""


class StreamOut:
    """A buffer whose values a stream writes to an output, one in each scan.

    The last values are repeated, as many as the loop has. The place in the buffer stays when the
    stream is stopped; only disabling the stream-out resets it.

    Args:
        targets: Addresses of the possible outputs.

    Attributes:
        target: Address of the output.
        n_bytes: Size of the buffer, in bytes.
        enabled: Whether it takes values.
        loop: Size of the loop for the new values.
    """

    def __init__(self, targets: Container[int]) -> None:
        self._targets = targets
        self.target = self.n_bytes = self.loop = 0
        self.enabled = self._waits = False
        self._values: list[float] = []
        self._new: list[float] = []
        self._next = self._looped = 0

    def set_target(self, address: int) -> None:
        """Choose the output."""
        if address not in self._targets:
            raise ModbusRefusal(DEVICE_FAILURE, _WRONG_TARGET)
        self.target = address

    def allocate(self, n_bytes: int) -> None:
        """Set the size of the buffer; two bytes of it cannot be used."""
        if n_bytes > OUT_MOST_BYTES:
            raise ModbusRefusal(DEVICE_FAILURE, _TOO_BIG)
        if n_bytes < OUT_LEAST_BYTES or n_bytes & (n_bytes - 1):
            raise ModbusRefusal(DEVICE_FAILURE, _WRONG_SIZE)
        self.n_bytes = n_bytes

    def enable(self, on: int) -> None:
        """Start to take values, or forget them and begin anew."""
        if on and not self.n_bytes:
            raise ModbusRefusal(DEVICE_FAILURE, _NO_SIZE)
        if not on:
            self._reset()
        self.enabled = bool(on)

    def set_loop_size(self, n_values: int) -> None:
        """Set how many of the new values are repeated."""
        self._require_enabled()
        if n_values > self._capacity:
            raise ModbusRefusal(DEVICE_FAILURE, _LOOP_TOO_BIG)
        self.loop = n_values

    def put(self, values: Sequence[float]) -> None:
        """Store new values; those that find no room are discarded."""
        self._require_enabled()
        room = self.free_bytes() // _BYTES
        self._new += values[:room]
        if len(values) > room:
            raise ModbusRefusal(DEVICE_FAILURE, _FULL)

    def set_loop(self, mode: int, others: Sequence["StreamOut"]) -> None:
        """Take the new values into use: at once, later, or together with those that wait."""
        self._require_enabled()
        if mode not in {USE_NOW, WAIT, SYNCHRONISE}:
            raise ModbusRefusal(DEVICE_FAILURE, _WRONG_VALUE)
        self._waits = mode == WAIT
        if mode == WAIT:
            return
        self._use()
        if mode == SYNCHRONISE:
            for other in others:
                if other._waits:  # noqa: SLF001 - of the same class
                    other._use()  # noqa: SLF001

    def free_bytes(self) -> int:
        """Return the number of free bytes: played values that are not repeated are free again."""
        held = max(len(self._values) - self._next, self._looped) + len(self._new)
        return (self._capacity - held) * _BYTES if self.n_bytes else 0

    def next_value(self) -> float | None:
        """Return the value of this scan; None after the last one of a buffer without a loop."""
        if self._next >= len(self._values):
            if not self._looped:
                return None
            self._next = len(self._values) - self._looped
        value = self._values[self._next]
        self._next += 1
        return value

    @property
    def _capacity(self) -> int:
        return self.n_bytes // _BYTES - 1

    def _use(self) -> None:
        if self._new:
            self._values, self._new, self._next = self._new, [], 0
        self._looped = min(self.loop, len(self._values))
        self._waits = False

    def _reset(self) -> None:
        self._values, self._new = [], []
        self._next = self._looped = self.loop = 0
        self._waits = False

    def _require_enabled(self) -> None:
        if not self.enabled:
            raise ModbusRefusal(DEVICE_FAILURE, _NOT_ENABLED)


def add_stream_outs(unit: EmulatedUnit, outs: Sequence[StreamOut]) -> None:
    """Add the registers of all stream-outs of a device."""
    for i, out in enumerate(outs):
        _add_stream_out(unit, out, registers.OUT_STEP * i, outs)


def _add_stream_out(
    unit: EmulatedUnit, out: StreamOut, step: int, outs: Sequence[StreamOut]
) -> None:
    numbers: list[tuple[int, Callable[[], float], Callable[[int], None]]] = [
        (registers.OUT_TARGET, lambda: out.target, out.set_target),
        (registers.OUT_BYTES, lambda: out.n_bytes, out.allocate),
        (registers.OUT_ENABLE, lambda: out.enabled, out.enable),
        (registers.OUT_LOOP_VALUES, lambda: out.loop, out.set_loop_size),
        (registers.OUT_SET_LOOP, lambda: 0, lambda mode: out.set_loop(mode, outs)),
    ]
    for address, get, set_ in numbers:
        unit.add("holding", address + step, "uint32", get, partial(_set_whole, set_))
    unit.add("holding", registers.OUT_FREE_BYTES + step, "uint32", out.free_bytes)
    for address, letter in ((registers.OUT_VALUES, "f"), (registers.OUT_WORDS, "H")):
        unit.add_port(address + step, RegisterPort(write=partial(_put, out, letter)))


def _set_whole(set_: Callable[[int], None], number: float) -> None:
    set_(int(number))


def _put(out: StreamOut, letter: str, words: bytes) -> None:
    size = calcsize(f">{letter}")
    if len(words) % size:
        raise ModbusRefusal(ILLEGAL_VALUE)
    values = unpack(f">{len(words) // size}{letter}", words)
    if not all(map(isfinite, values)):
        raise ModbusRefusal(ILLEGAL_VALUE)
    out.put(values)
