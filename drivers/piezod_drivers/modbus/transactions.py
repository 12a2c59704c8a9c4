"""One request and its reply at a time, in the frames of Modbus TCP and of Modbus RTU."""

from collections.abc import Iterable, Sequence
from struct import Struct
from typing import Final, Protocol

from piezod.devices.bus.conversation import PATIENCE, Conversation
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.checksum import checksum, is_whole
from piezod_drivers.modbus.requests import FAILED, Request, judge

_HEADER: Final = Struct(">HHHB")
_HEAD: Final = Struct(">HHH")
_LENGTHS: Final = range(3, 255)
_FIXED: Final = {5: 8, 6: 8, 15: 8, 16: 8}
_COUNTED: Final = frozenset({1, 2, 3, 4, 23})
_LEAST: Final = 5
"""Bytes of the shortest frame."""
_MOST: Final = 600
"""More bytes than two of the longest frames have."""


class Transactions(Protocol):
    """Carries requests to one device or to several on one line."""

    def open(self) -> None:
        """Connect.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        ...

    def close(self) -> None:
        """Let go. Never raises."""
        ...

    def ask(self, unit: int, requests: Sequence[Request], first: int = 0) -> tuple[int, bytes]:
        """Send one request of several that ask for the same; may be called in the loop.

        Args:
            unit: Address of the device on the line.
            requests: The same question in forms whose replies can be told apart.
            first: Which one is to be taken, if a late reply to it cannot come any more.

        Returns:
            Which one was sent, and the reply with its function.

        Raises:
            LineFault: If there is no answer in time, or the device refuses.
        """
        ...

    def is_free(self, unit: int, requests: Sequence[Request]) -> bool:
        """Tell whether no late reply can be mistaken for one to these; call it in the loop."""
        ...

    def settle(self) -> None:
        """Wait until no late reply can come that would be in the way; not to be called in the loop.

        Raises:
            LineFault: If the line is gone.
        """
        ...

    def now_ns(self) -> int:
        """Tell the instant on the line's clock; may be called in the loop."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, and forget it."""
        ...


class _OneLine:
    def __init__(self, line: Line, timeout_s: float) -> None:
        self._line, self._timeout_ns = line, round(timeout_s * 1e9)
        self._conversation = Conversation(line, timeout_s)
        self._noticed: set[DeviceFlag] = set()

    def open(self) -> None:
        """Connect, and forget what was before.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        self._line.open()
        self._conversation.restart()

    def close(self) -> None:
        """Let go. Never raises."""
        self._line.close()

    def now_ns(self) -> int:
        """Tell the instant on the line's clock; may be called in the loop."""
        return self._line.now_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, and forget it."""
        noticed = self._conversation.take_noticed() | self._noticed
        self._noticed = set()
        return noticed

    def _who(self, unit: int) -> str:
        return f"unit {unit} at {self._line.where}"


class TcpTransactions(_OneLine):
    """Modbus TCP: every request has a number of its own, which its reply repeats.

    So no reply is taken for another, however late. A reply with the right number and a wrong
    header or length is refused; of the data, only TCP's own checksum tells damage.

    Args:
        line: The connection.
        timeout_s: How long to wait for a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        super().__init__(line, timeout_s)
        self._number, self._tag = 0, b""

    def ask(self, unit: int, requests: Sequence[Request], first: int = 0) -> tuple[int, bytes]:
        """Send one request; may be called in the loop.

        Raises:
            LineFault: If there is no answer in time, or the device refuses.
        """
        request = requests[first]
        self._number = number = (self._number + 1) & 0xFFFF
        frame = _HEADER.pack(number, 0, len(request.pdu) + 1, unit) + request.pdu
        self._tag = frame[:2]
        reply = self._conversation.ask(frame, _length_tcp, self._is_reply)
        if reply[6] != unit:
            what = f"unit {reply[6]} answers in the place of {self._who(unit)}"
            raise LineFault(DeviceFlag.GARBAGE, what)
        pdu = reply[7:]
        if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
            return first, pdu
        return first, judge(pdu, request, self._who(unit))

    def settle(self) -> None:
        """Do nothing: no late reply is in the way."""

    def is_free(self, unit: int, requests: Sequence[Request]) -> bool:  # noqa: ARG002 - of RTU
        """Tell that no late reply can be mistaken for another."""
        return True

    def _is_reply(self, frame: bytes) -> bool:
        return frame.startswith(self._tag)


def _length_tcp(got: bytes) -> int:
    for start in range(len(got) - 5):
        _, protocol, length = _HEAD.unpack_from(got, start)
        if protocol == 0 and length in _LENGTHS:
            if start:
                return -start
            return length + 6 if len(got) >= length + 6 else 0
    return min(5 - len(got), 0)


class RtuTransactions(_OneLine):
    """Modbus RTU: frames with a checksum and without a number.

    What the beginning of a reply says is taken for its tag: unit, function, and number of bytes or
    address and value. A tag whose reply is overdue is not used until that reply has come, or can
    no longer come: ten time-outs later. Questions that have several forms go on meanwhile.

    Args:
        line: The serial line.
        timeout_s: How long to wait for a reply, in s.
        units: Addresses of the devices on the line; frames of others are garbage.
        silence_s: How long the line rests before a request, in s.
    """

    def __init__(
        self, line: Line, timeout_s: float, units: Iterable[int], silence_s: float
    ) -> None:
        super().__init__(line, timeout_s)
        self._units, self._silence_ns = frozenset(units), round(silence_s * 1e9)
        self._quiet_ns = 0
        self._tag, self._n_bytes = b"", 0
        self._owed: dict[bytes, int] = {}

    def open(self) -> None:
        """Connect, and wait for late replies to what was asked before.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        super().open()
        checksum(b"")  # makes its table now and not in the loop
        self.settle()

    def settle(self) -> None:
        """Wait for late replies until they come or no longer can; not to be called in the loop.

        A device does not know that its port was opened again, so they outlive that.

        Raises:
            LineFault: If the line is gone.
        """
        while self._owed and (left_ns := max(self._owed.values()) - self._line.now_ns()) > 0:
            self._absorb(self._line.receive(left_ns))
        self._owed.clear()

    def ask(self, unit: int, requests: Sequence[Request], first: int = 0) -> tuple[int, bytes]:
        """Send one request of several that ask for the same; may be called in the loop.

        Raises:
            LineFault: If there is no answer in time, or a late one may still come, or the device
                refuses.
        """
        which = self._free(unit, requests, first)
        request = requests[which]
        frame = bytes((unit,)) + request.pdu
        self._rest()
        self._n_bytes = request.n_bytes + 3
        try:
            reply = self._conversation.ask(frame + checksum(frame), self._length, self._is_reply)
        except LineFault as fault:
            if fault.flag is DeviceFlag.LATE_REPLY:
                self._owed[self._tag] = self._line.now_ns() + PATIENCE * self._timeout_ns
            raise
        finally:
            self._quiet_ns = self._line.now_ns() + self._silence_ns
        pdu = reply[1:-2]
        if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
            return which, pdu
        return which, judge(pdu, request, self._who(unit))

    def is_free(self, unit: int, requests: Sequence[Request]) -> bool:
        """Tell whether no late reply can be mistaken for one to these; call it in the loop."""
        if not self._owed:
            return True
        self._absorb(self._line.receive(0))
        now_ns = self._line.now_ns()
        return all(
            self._owed.get(bytes((unit,)) + request.echo, 0) <= now_ns for request in requests
        )

    def _free(self, unit: int, requests: Sequence[Request], first: int) -> int:
        """Choose a request whose reply cannot be mistaken for a late one."""
        self._tag = bytes((unit,)) + requests[first].echo
        if not self._owed:
            return first
        self._absorb(self._line.receive(0))
        now_ns = self._line.now_ns()
        for turn in range(len(requests)):
            which = (first + turn) % len(requests)
            self._tag = bytes((unit,)) + requests[which].echo
            if self._owed.get(self._tag, 0) <= now_ns:
                self._owed.pop(self._tag, None)
                return which
        raise LineFault(DeviceFlag.LATE_REPLY, f"{self._who(unit)}: a late reply may still come")

    def _rest(self) -> None:
        """Wait until the line has been silent for long enough."""
        while (left_ns := self._quiet_ns - self._line.now_ns()) > 0:
            self._absorb(self._line.receive(left_ns))

    def _absorb(self, got: bytes) -> None:
        """Take note of late replies among what has come while nothing was asked."""
        if got:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)
        while size := self._frame(got):
            if size > 0:
                self._forgive(got[:size])
            got = got[abs(size) :]

    def _forgive(self, frame: bytes) -> None:
        """A late reply has come: its tag can be used again."""
        # Replies keep their order: a refusal is that of the oldest request.
        refused = bytes((frame[0], frame[1] ^ FAILED)) if frame[1] & FAILED else frame
        for owed in self._owed:
            if frame.startswith(owed) or owed.startswith(refused):
                del self._owed[owed]
                return

    def _frame(self, got: bytes) -> int:
        """Find the first whole frame of one of our units, as `LengthOf` does."""
        n = len(got)
        for start in range(n - _LEAST + 1):
            size = _size(got, start) if got[start] in self._units else 0
            if 0 < size <= n - start and is_whole(got[start : start + size]):
                return -start if start else size
        return min(_MOST - n, 0)

    def _length(self, got: bytes) -> int:
        size = self._frame(got)
        if size == 0 and len(got) >= self._n_bytes and got.startswith(self._tag):
            raise LineFault(DeviceFlag.BAD_CHECKSUM, f"a reply at {self._line.where} is damaged")
        return size

    def _is_reply(self, frame: bytes) -> bool:
        tag = self._tag
        if frame.startswith(tag):
            return True
        if frame[0] == tag[0] and frame[1] == tag[1] | FAILED and not self._owes(tag):
            return True
        self._forgive(frame)
        return False

    def _owes(self, tag: bytes) -> bool:
        return any(owed[:2] == tag[:2] for owed in self._owed)


def _size(got: bytes, start: int) -> int:
    """Tell how long the frame is that begins there, 0 if that is not to be known."""
    function = got[start + 1]
    if function & FAILED:
        return _LEAST
    if function in _COUNTED:
        return _LEAST + got[start + 2]
    return _FIXED.get(function, 0)
