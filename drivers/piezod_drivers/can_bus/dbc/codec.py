"""Positions of signals in a frame, and conversion between their bits and values."""

from collections.abc import Mapping
from math import nan
from typing import Literal, NamedTuple


class DbcSignal(NamedTuple):
    """A signal: some bits of a frame, in the terms of a DBC file."""

    name: str  #: Name of the signal.
    #: The first bit: the lowest bit of a little-endian signal, the highest bit of a big-endian one;
    #: bit i of byte j is 8·j + i.
    start: int
    bits: int  #: Number of bits.
    big_endian: bool = False  #: Whether the highest byte comes first.
    signed: bool = False  #: Whether the highest bit is the sign.
    scale: float = 1.0  #: Physical value of one count.
    offset: float = 0.0  #: Physical value of count 0.
    lowest: float | None = None  #: Lowest physical value; None if the file does not limit it.
    highest: float | None = None  #: Highest physical value; None if the file does not limit it.
    unit: str = ""  #: Unit of the physical value; may be empty.

    @property
    def order(self) -> Literal["big", "little"]:
        """Order of the bytes."""
        return "big" if self.big_endian else "little"

    @property
    def raw_range(self) -> tuple[int, int]:
        """Lowest and highest number that the bits can hold."""
        if self.signed:
            return -(1 << self.bits - 1), (1 << self.bits - 1) - 1
        return 0, (1 << self.bits) - 1

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest physical value."""
        # Sorted, because a negative scale reverses the ends.
        ends = sorted(self.offset + raw * self.scale for raw in self.raw_range)
        low = ends[0] if self.lowest is None else max(ends[0], self.lowest)
        high = ends[1] if self.highest is None else min(ends[1], self.highest)
        return low, high

    def shift(self, n_bytes: int) -> int:
        """Return the position of the lowest bit in the number formed by the frame's bytes.

        The bytes form a number in the signal's own byte order. The result is negative if the signal
        does not fit into a frame of this length.
        """
        if not self.big_endian:
            return self.start if self.start + self.bits <= 8 * n_bytes else -1
        # A big-endian signal starts at its highest bit and continues downwards, into the next byte:
        # count the bits above it from the top of the frame.
        from_top = self.start // 8 * 8 + 7 - self.start % 8
        return 8 * n_bytes - from_top - self.bits


class DbcMessage(NamedTuple):
    """A frame with signals."""

    name: str  #: Name of the message.
    id: int  #: Identifier.
    n_bytes: int  #: Number of data bytes, 0 to 8.
    extended: bool  #: Whether the identifier has 29 bits.
    signals: Mapping[str, DbcSignal]  #: The signals by name.


class SignalReader:
    """Reads the value of one signal from the data of its frame."""

    def __init__(self, message: DbcMessage, signal: str) -> None:
        one = message.signals[signal]
        self._shift, self._mask = one.shift(message.n_bytes), (1 << one.bits) - 1
        self._order, self._sign = one.order, 1 << one.bits - 1 if one.signed else 0
        self._scale, self._offset = one.scale, one.offset
        self._low, self._high = one.range
        # Rounding may put a value at the end of its range slightly beyond it.
        margin = abs(one.scale) / 2
        self._low, self._high = self._low - margin, self._high + margin

    def raw(self, data: bytes) -> int:
        """Return the number that the bits hold. Real-time safe."""
        raw = int.from_bytes(data, self._order) >> self._shift & self._mask
        # Two's complement: the highest bit counts negative.
        return raw - 2 * self._sign if raw & self._sign else raw

    def value(self, data: bytes) -> float:
        """Return the physical value, NaN if it is out of range. Real-time safe."""
        value = self._offset + self.raw(data) * self._scale
        return value if self._low <= value <= self._high else nan


class SignalWriter:
    """Writes the value of one signal into the data of its frame."""

    def __init__(self, message: DbcMessage, signal: str) -> None:
        one = message.signals[signal]
        self._shift, self._mask = one.shift(message.n_bytes), (1 << one.bits) - 1
        # The bits of all other signals in the frame.
        self._others = ~(self._mask << self._shift)
        self._order, self._n_bytes = one.order, message.n_bytes
        self._scale, self._offset = one.scale, one.offset
        self._low, self._high = one.raw_range

    def put_raw(self, data: bytearray, raw: int) -> None:
        """Set the bits to a number; bits that do not fit are cut off. Real-time safe."""
        order = self._order
        others = int.from_bytes(data, order) & self._others
        number = others | (raw & self._mask) << self._shift
        data[:] = number.to_bytes(self._n_bytes, order)

    def put(self, data: bytearray, value: float) -> None:
        """Set the bits to the number nearest to a physical value. Real-time safe."""
        raw = round((value - self._offset) / self._scale)
        self.put_raw(data, min(max(raw, self._low), self._high))
