"""Where signals are in a frame, and what their bits stand for."""

from collections.abc import Mapping
from math import nan
from typing import Literal, NamedTuple


class DbcSignal(NamedTuple):
    """Some bits of a frame, as a DBC file describes them.

    Attributes:
        name: Its name.
        start: The first bit: the lowest one of a signal with the lowest byte first, the highest one
            of others; bit i of byte j is 8·j + i.
        bits: How many.
        big_endian: Whether the highest byte comes first.
        signed: Whether the highest bit is a sign.
        scale: Physical value of one.
        offset: Physical value of zero.
        lowest: Lowest physical value that is meant; None where that is not said.
        highest: Likewise.
        unit: Of the physical value; may be empty.
    """

    name: str
    start: int
    bits: int
    big_endian: bool = False
    signed: bool = False
    scale: float = 1.0
    offset: float = 0.0
    lowest: float | None = None
    highest: float | None = None
    unit: str = ""

    @property
    def order(self) -> Literal["big", "little"]:
        """Which byte comes first."""
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
        ends = sorted(self.offset + raw * self.scale for raw in self.raw_range)
        low = ends[0] if self.lowest is None else max(ends[0], self.lowest)
        high = ends[1] if self.highest is None else min(ends[1], self.highest)
        return low, high

    def shift(self, n_bytes: int) -> int:
        """Return where the lowest bit is in the number that a frame's bytes make.

        That is in the order of its own bytes; negative where it is not in a frame of this length.
        """
        if not self.big_endian:
            return self.start if self.start + self.bits <= 8 * n_bytes else -1
        from_top = self.start // 8 * 8 + 7 - self.start % 8
        return 8 * n_bytes - from_top - self.bits


class DbcMessage(NamedTuple):
    """A frame with signals.

    Attributes:
        name: Its name.
        id: Its identifier.
        n_bytes: Length of its data, 0 to 8.
        extended: Whether its identifier has 29 bits.
        signals: Its signals by name.
    """

    name: str
    id: int
    n_bytes: int
    extended: bool
    signals: Mapping[str, DbcSignal]


class SignalReader:
    """Takes the value of one signal out of the data of its frame.

    Args:
        message: The frame.
        signal: Name of the signal.
    """

    def __init__(self, message: DbcMessage, signal: str) -> None:
        one = message.signals[signal]
        self._shift, self._mask = one.shift(message.n_bytes), (1 << one.bits) - 1
        self._order, self._sign = one.order, 1 << one.bits - 1 if one.signed else 0
        self._scale, self._offset = one.scale, one.offset
        self._low, self._high = one.range
        # A value at the end of its range may be beyond it by rounding.
        margin = abs(one.scale) / 2
        self._low, self._high = self._low - margin, self._high + margin

    def raw(self, data: bytes) -> int:
        """Return the number that the bits hold; may be called in the loop."""
        raw = int.from_bytes(data, self._order) >> self._shift & self._mask
        return raw - 2 * self._sign if raw & self._sign else raw

    def value(self, data: bytes) -> float:
        """Return the physical value, NaN where it is out of its range; in the loop too."""
        value = self._offset + self.raw(data) * self._scale
        return value if self._low <= value <= self._high else nan


class SignalWriter:
    """Puts the value of one signal into the data of its frame.

    Args:
        message: The frame.
        signal: Name of the signal.
    """

    def __init__(self, message: DbcMessage, signal: str) -> None:
        one = message.signals[signal]
        self._shift, self._mask = one.shift(message.n_bytes), (1 << one.bits) - 1
        self._others = ~(self._mask << self._shift)
        self._order, self._n_bytes = one.order, message.n_bytes
        self._scale, self._offset = one.scale, one.offset
        self._low, self._high = one.raw_range

    def put_raw(self, data: bytearray, raw: int) -> None:
        """Set the bits to a number, of which what does not fit is cut; in the loop too."""
        order = self._order
        others = int.from_bytes(data, order) & self._others
        number = others | (raw & self._mask) << self._shift
        data[:] = number.to_bytes(self._n_bytes, order)

    def put(self, data: bytearray, value: float) -> None:
        """Set the bits to the number next to a physical value; may be called in the loop."""
        raw = round((value - self._offset) / self._scale)
        self.put_raw(data, min(max(raw, self._low), self._high))
