"""Frames that are sent and received, with their counters and checksums."""

from collections.abc import Callable, Mapping
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.dbc.checksum import ALGORITHMS, Algorithm
from piezod_drivers.can_bus.dbc.codec import DbcMessage, SignalReader, SignalWriter
from piezod_drivers.can_bus.frame import Frame

_BEGUN_ANEW: Final = 3
"""So many frames in a row whose counters follow one another, all before the last that counted."""


class Checksum:
    """The checksum of a message, a byte of its own.

    Args:
        message: The message.
        signal: Name of its signal.
        algorithm: How it is made of the other bytes.
    """

    def __init__(self, message: DbcMessage, signal: str, algorithm: Algorithm) -> None:
        self._place = message.signals[signal].start // 8
        self._make: Callable[[bytes | bytearray], int] = ALGORITHMS[algorithm]

    def of(self, data: bytes | bytearray) -> int:
        """Return what the checksum of these data should be; may be called in the loop."""
        return self._make(data[: self._place] + data[self._place + 1 :])

    def put(self, data: bytearray) -> None:
        """Set it; may be called in the loop."""
        data[self._place] = self.of(data)

    def is_right(self, data: bytes) -> bool:
        """Tell whether it is right; may be called in the loop."""
        return data[self._place] == self.of(data)


class Sent:
    """A message that this end sends; each frame is one more by its counter.

    Args:
        message: The message.
        constants: Signals that are always the same, as numbers without scale.
        counter: Name of the signal that counts; None for none.
        checksum: Its checksum; None for none.
    """

    def __init__(
        self,
        message: DbcMessage,
        constants: Mapping[str, int],
        counter: str | None,
        checksum: Checksum | None,
    ) -> None:
        self._message, self._checksum = message, checksum
        self._data = bytearray(message.n_bytes)
        for signal, raw in constants.items():
            SignalWriter(message, signal).put_raw(self._data, raw)
        self._writers: dict[str, SignalWriter] = {}
        self._counter = None if counter is None else SignalWriter(message, counter)
        self._count_mask = 0 if counter is None else (1 << message.signals[counter].bits) - 1
        self.count = 0
        """What the counter of the last frame was."""

    def uses(self, signal: str) -> None:
        """Prepare for values of a signal."""
        self._writers[signal] = SignalWriter(self._message, signal)

    def put(self, signal: str, value: float) -> None:
        """Set a signal, in all frames from now on; may be called in the loop."""
        self._writers[signal].put(self._data, value)

    def next(self) -> Frame:
        """Return the next frame; may be called in the loop."""
        data = self._data
        if self._counter is not None:
            self.count = self.count + 1 & self._count_mask
            self._counter.put_raw(data, self.count)
        if self._checksum is not None:
            self._checksum.put(data)
        return Frame(self._message.id, bytes(data), self._message.extended)


class Received:
    """A message that the device sends.

    Args:
        message: The message.
        counter: Name of the signal that counts; None for none.
        echo: Name of the signal that repeats the counter of a request; None for none.
        checksum: Its checksum; None for none.
    """

    def __init__(
        self,
        message: DbcMessage,
        counter: str | None,
        echo: str | None,
        checksum: Checksum | None,
    ) -> None:
        self._name, self._n_bytes, self._extended = message.name, message.n_bytes, message.extended
        self._checksum = checksum
        self._counter = None if counter is None else SignalReader(message, counter)
        self._counts = 0 if counter is None else 1 << message.signals[counter].bits
        self._echo = None if echo is None else SignalReader(message, echo)
        self._echo_mask = 0 if echo is None else (1 << message.signals[echo].bits) - 1
        self._last: int | None = None
        self._lagging = self._n_lagging = 0

    def require_sound(self, frame: Frame) -> None:
        """Check length and checksum; may be called in the loop.

        Raises:
            LineFault: `GARBAGE` or `BAD_CHECKSUM` if they are wrong.
        """
        if len(frame.data) != self._n_bytes or frame.remote or frame.extended != self._extended:
            what = f"{self._name} came with {len(frame.data)} bytes, not {self._n_bytes}"
            raise LineFault(DeviceFlag.GARBAGE, what)
        if self._checksum is not None and not self._checksum.is_right(frame.data):
            raise LineFault(DeviceFlag.BAD_CHECKSUM, f"the checksum of {self._name} is wrong")

    def is_newer(self, frame: Frame) -> bool:
        """Tell whether a sound frame was sent after the last; may be called in the loop.

        By its counter; one that lags by less than half of the counter's range was sent before.
        When several in a row count on from there, the sender has begun anew.
        """
        if self._counter is None:
            return True
        count, last = self._counter.raw(frame.data) % self._counts, self._last
        if last is not None and (last - count) % self._counts < self._counts // 2:
            follows = count == (self._lagging + 1) % self._counts
            self._n_lagging = self._n_lagging + 1 if follows else 1
            self._lagging = count
            if self._n_lagging < _BEGUN_ANEW:
                return False
        self._last, self._n_lagging = count, 0
        return True

    def repeats(self, frame: Frame, count: int) -> bool:
        """Tell whether a sound frame answers the request of this count; in the loop too."""
        return self._echo is None or self._echo.raw(frame.data) & self._echo_mask == (
            count & self._echo_mask
        )
