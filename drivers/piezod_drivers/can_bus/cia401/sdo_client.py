"""The canopen library's SDO client and NMT master over a `FrameBus`, without its threads."""

from collections.abc import Callable, Sequence
from typing import Final

import canopen
from canopen.nmt import NmtMaster
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.can_bus.cia401.objects import (
    SDO_ANSWER,
    SDO_REQUEST,
    SEGMENT_BYTES,
    WORD_BYTES,
)
from piezod_drivers.can_bus.conversation import MAX_FRAMES
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus

_ANSWER_NS: Final = 500_000_000
"""Longest time that a node may take for an access; some write to flash memory."""
_LEFT_S: Final = 0.001

_NO_OBJECT: Final = frozenset(
    {0x0601_0000, 0x0601_0001, 0x0602_0000, 0x0604_0047, 0x0609_0011, 0x0800_0000}
)
"""Abort codes of nodes for an object or a sub-index that does not exist or cannot be read: missing,
unsupported or write-only, incompatible, or a general error."""
_WRONG_LENGTH: Final = frozenset({0x0607_0010, 0x0607_0012, 0x0607_0013})
"""Abort codes for a value of another length."""
_TOGGLE: Final = 0x10
_COMMAND: Final = 0xE0
# The command in a reply, by the command of the request (CiA 301). A reply with address repeats that
# of its request.
_WITH_ADDRESS: Final = {0x20: 0x60, 0x40: 0x40}
_SEGMENTS: Final = {0x00: 0x20, 0x60: 0x00}
_ABORT: Final = 0x80


class SdoRefusedError(Exception):
    """Raised if a node refuses access to an object.

    Args:
        code: Abort code.
        what: Message to people.
    """

    def __init__(self, code: int, what: str) -> None:
        super().__init__(what)
        self.code = code

    @property
    def is_missing(self) -> bool:
        """Whether the node has no such object."""
        return self.code in _NO_OBJECT

    @property
    def is_of_length(self) -> bool:
        """Whether the value had another length than the object."""
        return self.code in _WRONG_LENGTH


class _Network(canopen.Network):
    """Sends through a `FrameBus`."""

    def __init__(self, frame_bus: FrameBus) -> None:
        super().__init__()
        self._frame_bus = frame_bus

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._frame_bus.send(Frame(can_id, bytes(data), remote=remote))


class _Client(SdoClient):
    """Reads frames itself while it waits; the library's client relies on a thread for that."""

    # The library's own wait; all waiting is done in `read_response`.
    RESPONSE_TIMEOUT = _LEFT_S

    def __init__(self, node: int, bus: FrameBus, take: Callable[[Frame], None]) -> None:
        # Objects are accessed by index and as bytes, so the client needs no EDS file.
        nothing = canopen.ObjectDictionary()  # type: ignore[no-untyped-call] # the library's
        ids = SDO_REQUEST + node, SDO_ANSWER + node
        super().__init__(*ids, nothing)  # type: ignore[no-untyped-call] # likewise
        self._bus, self._on_other_frame = bus, take
        self._request = bytes(8)
        self.unfitting = b""
        """The last frame that came instead of a reply to the last request; empty if none did."""

    def send_request(self, request: bytes | bytearray) -> None:
        """Send a request; drop replies that came before it."""
        # The limit ends the loop on a flooded bus.
        for _ in range(MAX_FRAMES):
            frame = self._bus.receive(0)
            if frame is None:
                break
            if frame.id != self.tx_cobid:
                self._on_other_frame(frame)
        if request[0] != _ABORT:  # giving up has no reply
            self._request, self.unfitting = bytes(request), b""
        super().send_request(request)  # type: ignore[no-untyped-call] # the library's

    def read_response(self) -> bytes:
        """Wait for the reply."""
        end_ns = self._bus.now_ns() + _ANSWER_NS
        while self.responses.empty() and (left_ns := end_ns - self._bus.now_ns()) > 0:
            frame = self._bus.receive(left_ns)
            if frame is None:
                continue
            if frame.id != self.tx_cobid:
                self._on_other_frame(frame)
            elif frame.is_plain and self._is_reply(frame.data):
                self.responses.put(frame.data)
            else:
                self.unfitting = frame.data
        # Takes the reply from the queue, or raises the library's time-out error at once.
        answer: bytes = super().read_response()  # type: ignore[no-untyped-call] # likewise
        return answer

    def _is_reply(self, data: bytes) -> bool:
        """Return whether a frame answers the last request: a late or repeated one does not."""
        if len(data) != len(self._request):
            return False
        command, got = self._request[0] & _COMMAND, data[0] & _COMMAND
        same_address = data[1:4] == self._request[1:4]
        if command in _SEGMENTS:
            same_turn = (data[0] ^ self._request[0]) & _TOGGLE == 0
            return got == _ABORT or (got == _SEGMENTS[command] and same_turn)
        return same_address and got in {_ABORT, _WITH_ADDRESS.get(command)}


class SdoAccess:
    """Reads and writes objects of a node and changes its state. Not real-time safe.

    Every method raises `LineFault` if the node does not reply, or the bus fails.

    Args:
        node: Node number.
        take: Called with each frame that comes meanwhile and is not a reply.
    """

    def __init__(self, node: int, bus: FrameBus, take: Callable[[Frame], None]) -> None:
        self._where = f"node {node} at {bus.where}"
        network = _Network(bus)
        self._client = _Client(node, bus, take)
        self._client.network = network
        self._master = NmtMaster(node)
        self._master.network = network

    def send_nmt(self, command: int) -> None:
        """Send the node an NMT command, which changes its state.

        Raises:
            LineFault: Any fault of the bus.
        """
        self._master.send_command(command)

    def read(self, index: int, number: int = 0) -> tuple[bytes, bool]:
        """Return the bytes of an object, and whether the node tells how many they are.

        If it does not, those beyond the size of the object mean nothing.

        Raises:
            SdoRefusedError: If the node refuses.
            LineFault: `LATE_REPLY` if the node does not reply, or any fault of the bus.
        """
        try:
            stream = self._client.open(index, number, buffering=0)  # type: ignore[no-untyped-call]
            data = bytes(stream.read())
        except SdoAbortedError as error:
            raise self._refused("read", index, number, error) from error
        except SdoCommunicationError as error:
            raise self._no_reply(error) from error
        if stream.size is not None:
            return data[: stream.size], True
        # The last segment has its own size; without one it looks full.
        return data, stream.exp_data is None and len(data) % SEGMENT_BYTES != 0

    def number(self, index: int, number: int, n_bytes: int) -> int:
        """Return an object as an unsigned number; raises as `read`.

        Args:
            index: Index of the object.
            number: Its sub-index.
            n_bytes: Its size, for a node that does not tell it.
        """
        data, is_told = self.read(index, number)
        return int.from_bytes(data if is_told else data[:n_bytes], "little")

    def require_word(self, index: int, number: int) -> None:
        """Check that the loop can read a channel.

        Raises:
            DeviceError: If the node refuses, or the channel has not 16 bits.
        """
        data, is_told = self.read(index, number)
        if is_told and len(data) != WORD_BYTES:
            what = f"{self._where}: object 0x{index:04X}:{number} has {len(data)} bytes, "
            raise DeviceError(
                f"{what}expected {WORD_BYTES}: only channels of 16 bits are supported"
            )

    def text(self, index: int) -> str:
        """Return the printable characters of an object; empty if there is none."""
        try:
            text = self.read(index)[0].decode("latin-1")
        except SdoRefusedError:
            return ""
        # Some nodes pad texts with zeros or spaces.
        return "".join(character for character in text if character.isprintable()).strip()

    def write_sized(self, index: int, number: int, value: int, sizes: Sequence[int]) -> None:
        """Write an object whose size differs between nodes; raises as `read`.

        Args:
            index: Index of the object.
            number: Its sub-index.
            value: The value.
            sizes: Possible sizes, in bytes, for a node that does not tell it.
        """
        data, is_told = self.read(index, number)
        *others, last = (len(data),) if is_told else sizes
        for n_bytes in others:
            try:
                self.write(index, number, value, n_bytes)
            except SdoRefusedError as error:
                if not error.is_of_length:
                    raise
            else:
                return
        self.write(index, number, value, last)

    def write(self, index: int, number: int, value: int, n_bytes: int) -> None:
        """Write an object; raises as `read`."""
        # The modulo gives a negative value as two's complement.
        data = (value % (1 << 8 * n_bytes)).to_bytes(n_bytes, "little")
        try:
            self._client.download(index, number, data)
        except SdoAbortedError as error:
            raise self._refused("set", index, number, error) from error
        except SdoCommunicationError as error:
            raise self._no_reply(error) from error

    def _refused(
        self, what: str, index: int, number: int, error: SdoAbortedError
    ) -> SdoRefusedError:
        where = f"{self._where}: object 0x{index:04X}:{number}"
        return SdoRefusedError(error.code, f"{where} cannot be {what}: {error}")

    def _no_reply(self, error: Exception) -> LineFault:
        what = f"{self._where} does not answer: {error}"
        if unfitting := self._client.unfitting:
            what += f"; what came does not fit: {unfitting.hex(' ')}"
        return LineFault(DeviceFlag.LATE_REPLY, what)
