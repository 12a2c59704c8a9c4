"""Requests and replies in the frames of Modbus RTU."""

from collections.abc import Iterable, Sequence
from typing import Final

from piezod.devices.bus.conversation import PATIENCE
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.checksum import checksum, has_valid_checksum, with_checksum
from piezod_drivers.modbus.codec import EXCEPTION_BIT, ModbusRequest, check_reply
from piezod_drivers.modbus.transactions import LineTransactions

# Lengths of replies by function code: fixed, or given by a byte count behind the code.
_FIXED: Final = {5: 8, 6: 8, 15: 8, 16: 8}
_COUNTED: Final = frozenset({1, 2, 3, 4, 23})
_MIN_BYTES: Final = 5
"""Number of bytes of the shortest frame."""
_MAX_BYTES: Final = 600
"""More bytes than two of the longest frames have."""


class RtuTransactions(LineTransactions):
    """Modbus RTU: frames with a checksum and without a number.

    The first bytes of a reply serve as its tag: unit, function, and either the number of bytes or
    address and value. While the reply with a tag is overdue, no request with the same tag is sent,
    until that reply has come or counts as lost, ten time-outs later. If a request has several
    forms, another form is used meanwhile.

    Args:
        timeout_s: Longest wait for a reply, in s.
        units: Addresses of the devices on the line; frames of other devices are garbage.
        silence_s: Time without bytes that has to precede a request, in s.
    """

    def __init__(
        self, line: Line, timeout_s: float, units: Iterable[int], silence_s: float
    ) -> None:
        super().__init__(line, timeout_s)
        self._units, self._silence_ns = frozenset(units), round(silence_s * 1e9)
        self._silent_until_ns = 0
        self._expected_tag, self._expected_bytes = b"", 0
        self._overdue: dict[bytes, int] = {}

    def open(self) -> None:
        """Connect, and wait for late replies to earlier requests.

        Raises:
            DeviceUnavailableError: If that fails.
        """
        super().open()
        checksum(b"")  # computes its table now, not in the loop
        self.settle()

    def settle(self) -> None:
        """Wait until late replies have come or count as lost. Not real-time safe.

        Late replies may also come after the port was opened again: the device does not notice that.

        Raises:
            LineFault: If the line is lost.
        """
        while self._overdue and (left_ns := max(self._overdue.values()) - self._line.now_ns()) > 0:
            self._drop_received(self._line.receive(left_ns))
        self._overdue.clear()

    def ask(self, unit: int, requests: Sequence[ModbusRequest], first: int = 0) -> bytes:
        """Send one of several equivalent requests and return its reply. Real-time safe.

        Raises:
            LineFault: If there is no reply in time, a late one may still come, or the device
                refuses.
        """
        request = self._choose(unit, requests, first)
        frame = with_checksum(bytes((unit,)) + request.pdu)
        self._wait_for_silence()
        # Unit and checksum are added to the reply.
        self._expected_bytes = request.n_bytes + 3
        try:
            reply = self._conversation.ask(frame, self._length, self._is_reply)
        except LineFault as fault:
            if fault.flag is DeviceFlag.LATE_REPLY:
                self._overdue[self._expected_tag] = (
                    self._line.now_ns() + PATIENCE * self._timeout_ns
                )
            raise
        finally:
            # Also after a fault: late bytes of the reply may still be on the line.
            self._silent_until_ns = self._line.now_ns() + self._silence_ns
        pdu = reply[1:-2]
        if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
            return pdu
        return check_reply(pdu, request, self.name_of(unit))

    def is_free(self, unit: int, requests: Sequence[ModbusRequest]) -> bool:
        """Return whether no late reply can be mistaken for one to these. Real-time safe."""
        if not self._overdue:
            return True
        self._drop_received(self._line.receive(0))
        now_ns = self._line.now_ns()
        return all(
            self._overdue.get(bytes((unit,)) + request.echo, 0) <= now_ns for request in requests
        )

    def _choose(self, unit: int, requests: Sequence[ModbusRequest], first: int) -> ModbusRequest:
        """Return a request whose reply cannot be mistaken for a late one."""
        self._expected_tag = bytes((unit,)) + requests[first].echo
        if not self._overdue:
            return requests[first]
        self._drop_received(self._line.receive(0))
        now_ns = self._line.now_ns()
        for turn in range(len(requests)):
            request = requests[(first + turn) % len(requests)]
            self._expected_tag = bytes((unit,)) + request.echo
            if self._overdue.get(self._expected_tag, 0) <= now_ns:
                # Overdue for too long: it counts as lost.
                self._overdue.pop(self._expected_tag, None)
                return request
        raise LineFault(DeviceFlag.LATE_REPLY, f"{self.name_of(unit)}: a late reply may still come")

    def _wait_for_silence(self) -> None:
        """Wait until the line has been silent for the required time."""
        while (left_ns := self._silent_until_ns - self._line.now_ns()) > 0:
            self._drop_received(self._line.receive(left_ns))

    def _drop_received(self, got: bytes) -> None:
        """Drop bytes that no request has asked for; note late replies among them."""
        if got:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)
        # A negative size is garbage in front of a frame, as `LengthOf` defines it.
        while size := self._find_frame(got):
            if size > 0:
                self._note_late_reply(got[:size])
            got = got[abs(size) :]

    def _note_late_reply(self, frame: bytes) -> None:
        """Note that a late reply has come: its tag can be used again."""
        # Devices reply in order, so an exception belongs to the oldest request of its function.
        refused = bytes((frame[0], frame[1] ^ EXCEPTION_BIT)) if frame[1] & EXCEPTION_BIT else frame
        for overdue in self._overdue:
            if frame.startswith(overdue) or overdue.startswith(refused):
                del self._overdue[overdue]
                return

    def _find_frame(self, got: bytes) -> int:
        """Return the length of the first valid frame of our units, as `LengthOf` does."""
        n = len(got)
        for start in range(n - _MIN_BYTES + 1):
            size = _frame_size(got, start) if got[start] in self._units else 0
            if 0 < size <= n - start and has_valid_checksum(got[start : start + size]):
                return -start if start else size
        # More garbage than two frames can hold is dropped.
        return min(_MAX_BYTES - n, 0)

    def _length(self, got: bytes) -> int:
        n, begins = len(got), got.startswith(self._expected_tag)
        if begins and n == self._expected_bytes and has_valid_checksum(got):
            return n  # nearly always: the reply and nothing else
        size = self._find_frame(got)
        # The reply has its full length, and no valid frame begins anywhere: waiting for more would
        # only lead to a time-out.
        if size == 0 and n >= self._expected_bytes and begins:
            raise LineFault(
                DeviceFlag.BAD_CHECKSUM, f"a reply from {self._line.where} has a wrong checksum"
            )
        return size

    def _is_reply(self, frame: bytes) -> bool:
        tag = self._expected_tag
        if frame.startswith(tag):
            return True
        # An exception repeats only unit and function. It is accepted if no other reply of this
        # function is overdue.
        if frame[0] == tag[0] and frame[1] == tag[1] | EXCEPTION_BIT and not self._is_overdue(tag):
            return True
        self._note_late_reply(frame)
        return False

    def _is_overdue(self, tag: bytes) -> bool:
        return any(overdue[:2] == tag[:2] for overdue in self._overdue)


def _frame_size(got: bytes, start: int) -> int:
    """Return the length of the frame that starts there, 0 if it is unknown."""
    function = got[start + 1]
    if function & EXCEPTION_BIT:
        return _MIN_BYTES
    if function in _COUNTED:
        return _MIN_BYTES + got[start + 2]
    return _FIXED.get(function, 0)
