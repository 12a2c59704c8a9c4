"""The SDO server of an emulated node, with the abort codes of CiA 301."""

from enum import IntEnum
from typing import Final, Protocol

from piezod_drivers.can_bus.cia401.emulation.object_dictionary import Entry

# Terms of SDO (CiA 301): an expedited transfer carries up to four bytes in one frame, a segmented
# one seven bytes per frame, with a toggle bit. The top three bits of a frame are the command.
_BYTES: Final = 8
_EXPEDITED: Final = 4
_TOGGLE: Final = 0x10
_UPLOAD_SEGMENT: Final = 3
_ABORT: Final = 4


class AbortCode(IntEnum):
    """Reasons for which a node refuses an access."""

    TOGGLE = 0x0503_0000
    UNKNOWN_COMMAND = 0x0504_0001
    UNSUPPORTED_ACCESS = 0x0601_0000
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    CANNOT_BE_MAPPED = 0x0604_0041
    TOO_MUCH_MAPPED = 0x0604_0042
    INCOMPATIBLE = 0x0604_0043
    TOO_LONG = 0x0607_0012
    TOO_SHORT = 0x0607_0013
    NO_SUB_INDEX = 0x0609_0011
    OUT_OF_RANGE = 0x0609_0030
    WRONG_STATE = 0x0800_0022


class AbortError(Exception):
    """Raised if an access is refused."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(code.name)
        self.code = code


class ObjectAccess(Protocol):
    """The objects that a server gives access to."""

    def entry(self, index: int, number: int) -> Entry:
        """Return an object; raises `AbortError`."""
        ...

    def value(self, index: int, number: int) -> int | str:
        """Return the value of an object."""
        ...

    def set(self, index: int, number: int, value: int) -> None:
        """Write an object; raises `AbortError` if that is not allowed."""
        ...


class SdoServer:
    """Answers SDO requests, one at a time.

    Args:
        objects: The objects that it gives access to.
    """

    def __init__(self, objects: ObjectAccess) -> None:
        self._objects = objects
        self._rest = b""
        self._toggle = 0
        self._address_bytes = b"\0\0\0"

    def answer(self, request: bytes) -> bytes | None:
        """Return the reply to a request, None if there is none. Never raises."""
        if len(request) != _BYTES:
            return None
        command = request[0] >> 5
        # The client has given up a transfer; an abort has no reply.
        if command == _ABORT:
            self._rest = b""
            return None
        # A request for a segment has no address: it continues the last upload.
        if command != _UPLOAD_SEGMENT:
            self._address_bytes = request[1:4]
        try:
            return self._run(command, request)
        except AbortError as refusal:
            return bytes((0x80,)) + self._address_bytes + refusal.code.to_bytes(4, "little")

    def _run(self, command: int, request: bytes) -> bytes:
        match command:
            case 1:
                return self._download(request)
            case 2:
                return self._upload()
            case 3:
                return self._segment(request[0])
            case _:
                raise AbortError(AbortCode.UNKNOWN_COMMAND)

    def _address(self) -> tuple[int, int]:
        return self._address_bytes[0] | self._address_bytes[1] << 8, self._address_bytes[2]

    def _upload(self) -> bytes:
        index, number = self._address()
        entry, value = self._objects.entry(index, number), self._objects.value(index, number)
        if isinstance(value, str):
            data = value.encode("ascii")
        else:
            data = (value % (1 << 8 * entry.n_bytes)).to_bytes(entry.n_bytes, "little")
        if len(data) <= _EXPEDITED:
            # Upload reply, expedited, with the length given: bits 2 and 3 count the unused bytes.
            head = 0x43 | (_EXPEDITED - len(data)) << 2
            return bytes((head,)) + self._address_bytes + data.ljust(_EXPEDITED, b"\0")
        self._rest, self._toggle = data, 0
        # Upload reply, segmented: the data is the length.
        return bytes((0x41,)) + self._address_bytes + len(data).to_bytes(4, "little")

    def _segment(self, head: int) -> bytes:
        if not self._rest:
            raise AbortError(AbortCode.UNKNOWN_COMMAND)
        if head & _TOGGLE != self._toggle:
            raise AbortError(AbortCode.TOGGLE)
        data, self._rest = self._rest[:7], self._rest[7:]
        # Bits 1 to 3 count the unused bytes, bit 0 marks the last segment.
        answer = self._toggle | (7 - len(data)) << 1 | (not self._rest)
        self._toggle ^= _TOGGLE
        return bytes((answer,)) + data.ljust(7, b"\0")

    def _download(self, request: bytes) -> bytes:
        index, number = self._address()
        entry = self._objects.entry(index, number)
        if entry.access == "ro":
            raise AbortError(AbortCode.READ_ONLY)
        head = request[0]
        if not head & 2:  # segmented: no writable object is longer than four bytes
            raise AbortError(AbortCode.TOO_LONG)
        # Without the length bit, the object's own length applies.
        n_bytes = _EXPEDITED - (head >> 2 & 3) if head & 1 else entry.n_bytes
        if n_bytes != entry.n_bytes:
            too_long = n_bytes > entry.n_bytes
            raise AbortError(AbortCode.TOO_LONG if too_long else AbortCode.TOO_SHORT)
        value = int.from_bytes(request[4 : 4 + n_bytes], "little", signed=entry.is_signed)
        self._objects.set(index, number, value)
        # Download reply.
        return bytes((0x60,)) + self._address_bytes + bytes(4)
