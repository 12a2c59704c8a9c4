"""Requests and replies in the frames of Modbus RTU."""

from collections.abc import Iterable, Sequence
from typing import Final

from piezod.devices.bus.conversation import PATIENCE
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.checksum import checksum, framed, is_whole
from piezod_drivers.modbus.codec import FAILED, ModbusRequest, judge
from piezod_drivers.modbus.transactions import OneLine

_FIXED: Final = {5: 8, 6: 8, 15: 8, 16: 8}
_COUNTED: Final = frozenset({1, 2, 3, 4, 23})
_LEAST: Final = 5
"""Bytes of the shortest frame."""
_MOST: Final = 600
"""More bytes than two of the longest frames have."""


class RtuTransactions(OneLine):
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

    def ask(self, unit: int, requests: Sequence[ModbusRequest], first: int = 0) -> bytes:
        """Send one request of several that ask for the same; may be called in the loop.

        Raises:
            LineFault: If there is no answer in time, or a late one may still come, or the device
                refuses.
        """
        request = self._free(unit, requests, first)
        frame = framed(bytes((unit,)) + request.pdu)
        self._rest()
        self._n_bytes = request.n_bytes + 3
        try:
            reply = self._conversation.ask(frame, self._length, self._is_reply)
        except LineFault as fault:
            if fault.flag is DeviceFlag.LATE_REPLY:
                self._owed[self._tag] = self._line.now_ns() + PATIENCE * self._timeout_ns
            raise
        finally:
            self._quiet_ns = self._line.now_ns() + self._silence_ns
        pdu = reply[1:-2]
        if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
            return pdu
        return judge(pdu, request, self.who(unit))

    def is_free(self, unit: int, requests: Sequence[ModbusRequest]) -> bool:
        """Tell whether no late reply can be mistaken for one to these; call it in the loop."""
        if not self._owed:
            return True
        self._absorb(self._line.receive(0))
        now_ns = self._line.now_ns()
        return all(
            self._owed.get(bytes((unit,)) + request.echo, 0) <= now_ns for request in requests
        )

    def _free(self, unit: int, requests: Sequence[ModbusRequest], first: int) -> ModbusRequest:
        """Choose a request whose reply cannot be mistaken for a late one."""
        self._tag = bytes((unit,)) + requests[first].echo
        if not self._owed:
            return requests[first]
        self._absorb(self._line.receive(0))
        now_ns = self._line.now_ns()
        for turn in range(len(requests)):
            request = requests[(first + turn) % len(requests)]
            self._tag = bytes((unit,)) + request.echo
            if self._owed.get(self._tag, 0) <= now_ns:
                self._owed.pop(self._tag, None)
                return request
        raise LineFault(DeviceFlag.LATE_REPLY, f"{self.who(unit)}: a late reply may still come")

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
        n, begins = len(got), got.startswith(self._tag)
        if begins and n == self._n_bytes and is_whole(got):
            return n  # as nearly always: the reply and nothing else
        size = self._frame(got)
        if size == 0 and n >= self._n_bytes and begins:
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
