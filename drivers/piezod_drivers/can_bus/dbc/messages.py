"""Messages as they are sent and received, with their counters and checksums."""

from collections.abc import Callable, Mapping
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.dbc.checksum import ALGORITHMS, Algorithm
from piezod_drivers.can_bus.dbc.codec import DbcMessage, SignalReader, SignalWriter
from piezod_drivers.can_bus.frame import Frame

_RESTARTED_AFTER: Final = 3
"""After this many frames in a row with consecutive counters, all too low, the sender counts as
restarted.
"""


class Checksum:
    """The checksum of a message, one byte of the frame.

    Args:
        signal: Name of the checksum's signal.
        algorithm: Algorithm that computes it from the other bytes.
    """

    def __init__(self, message: DbcMessage, signal: str, algorithm: Algorithm) -> None:
        self._place = message.signals[signal].start // 8
        self._algorithm: Callable[[bytes | bytearray], int] = ALGORITHMS[algorithm]

    def compute(self, data: bytes | bytearray) -> int:
        """Return the correct checksum of a frame's data. Real-time safe."""
        return self._algorithm(data[: self._place] + data[self._place + 1 :])

    def put(self, data: bytearray) -> None:
        """Write the checksum into the data. Real-time safe."""
        data[self._place] = self.compute(data)

    def is_correct(self, data: bytes) -> bool:
        """Return whether the checksum in the data is correct. Real-time safe."""
        return data[self._place] == self.compute(data)


class SentMessage:
    """A message that this end sends; its counter goes up by one with each frame.

    Args:
        constants: Raw values of signals that never change.
        counter: Name of the counter's signal; None for none.
        checksum: The checksum; None for none.
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
            # Written once: later frames only change the prepared signals, the counter and the
            # checksum.
            SignalWriter(message, signal).put_raw(self._data, raw)
        self._writers: dict[str, SignalWriter] = {}
        self._counter = None if counter is None else SignalWriter(message, counter)
        self._count_mask = 0 if counter is None else (1 << message.signals[counter].bits) - 1
        self.count = 0
        """Counter of the last frame."""

    def prepare(self, signal: str) -> None:
        """Prepare to set a signal; call it once for each signal."""
        self._writers[signal] = SignalWriter(self._message, signal)

    def put(self, signal: str, value: float) -> None:
        """Set a signal in all frames from now on. Real-time safe."""
        self._writers[signal].put(self._data, value)

    def next(self) -> Frame:
        """Return the next frame. Real-time safe."""
        data = self._data
        if self._counter is not None:
            self.count = self.count + 1 & self._count_mask
            self._counter.put_raw(data, self.count)
        if self._checksum is not None:
            self._checksum.put(data)
        return Frame(self._message.id, bytes(data), self._message.extended)


class ReceivedMessage:
    """A message that the device sends.

    Args:
        counter: Name of the counter's signal; None for none.
        echo: Name of the signal that repeats the counter of the request; None for none.
        checksum: The checksum; None for none.
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
        self._lag_count = self._n_consecutive = 0

    def require_valid(self, frame: Frame) -> None:
        """Check length and checksum of a frame. Real-time safe.

        Raises:
            LineFault: `GARBAGE` or `BAD_CHECKSUM` if they are wrong.
        """
        # A frame of another kind with the same identifier comes from another device, or the file is
        # wrong.
        if len(frame.data) != self._n_bytes or frame.remote or frame.extended != self._extended:
            what = f"{self._name} has {len(frame.data)} bytes, expected {self._n_bytes}"
            raise LineFault(DeviceFlag.GARBAGE, what)
        if self._checksum is not None and not self._checksum.is_correct(frame.data):
            raise LineFault(DeviceFlag.BAD_CHECKSUM, f"the checksum of {self._name} is wrong")

    def is_newer(self, frame: Frame) -> bool:
        """Return whether a valid frame was sent after the last one. Real-time safe.

        The counter decides. A frame that lags by less than half of the counter's range was sent
        earlier. If several frames in a row count on from there, the sender has restarted.
        """
        if self._counter is None:
            return True
        count, last = self._counter.raw(frame.data) % self._counts, self._last
        # The difference modulo the range: 0 is a repetition, up to half of the range is "sent
        # earlier".
        if last is not None and (last - count) % self._counts < self._counts // 2:
            # A restarted sender counts on from its own start; a single late frame does not.
            follows = count == (self._lag_count + 1) % self._counts
            self._n_consecutive = self._n_consecutive + 1 if follows else 1
            self._lag_count = count
            if self._n_consecutive < _RESTARTED_AFTER:
                return False
        self._last, self._n_consecutive = count, 0
        return True

    def answers_request(self, frame: Frame, count: int) -> bool:
        """Return whether a valid frame repeats this counter of a request. Real-time safe."""
        # The echo may have fewer bits than the counter.
        return self._echo is None or self._echo.raw(frame.data) & self._echo_mask == (
            count & self._echo_mask
        )
