"""The canopen library's SDO client and NMT master over a `FrameBus`, without its threads."""

from collections.abc import Callable
from typing import Final

import canopen
from canopen.nmt import NmtMaster
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401.objects import SDO_ANSWER, SDO_REQUEST
from piezod_drivers.can_bus.conversation import MAX_FRAMES
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus

_ANSWER_NS: Final = 500_000_000
"""Longest time that a node may take for an access; some write to flash memory."""
_LEFT_S: Final = 0.001

NO_OBJECT: Final = frozenset({0x0602_0000, 0x0609_0011})
"""Abort codes for an object or a sub-index that does not exist."""


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
        return self.code in NO_OBJECT


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

    def send_request(self, request: bytes | bytearray) -> None:
        """Send a request; drop replies that came before it."""
        # The limit ends the loop on a flooded bus.
        for _ in range(MAX_FRAMES):
            frame = self._bus.receive(0)
            if frame is None:
                break
            if frame.id != self.tx_cobid:
                self._on_other_frame(frame)
        super().send_request(request)  # type: ignore[no-untyped-call] # the library's

    def read_response(self) -> bytes:
        """Wait for the reply."""
        end_ns = self._bus.now_ns() + _ANSWER_NS
        while self.responses.empty() and (left_ns := end_ns - self._bus.now_ns()) > 0:
            frame = self._bus.receive(left_ns)
            if frame is None:
                continue
            if frame.id == self.tx_cobid and frame.is_plain and len(frame.data) == 8:
                self.responses.put(frame.data)
            else:
                self._on_other_frame(frame)
        # Takes the reply from the queue, or raises the library's time-out error at once.
        answer: bytes = super().read_response()  # type: ignore[no-untyped-call] # likewise
        return answer


class SdoAccess:
    """Reads and writes objects of a node and changes its state. Not real-time safe.

    Args:
        node: Node number.
        bus: The bus.
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

    def read(self, index: int, number: int = 0) -> bytes:
        """Return the bytes of an object.

        Raises:
            SdoRefusedError: If the node refuses.
            LineFault: `LATE_REPLY` if the node does not reply, or any fault of the bus.
        """
        try:
            return self._client.upload(index, number)
        except SdoAbortedError as error:
            raise self._refused("read", index, number, error) from error
        except SdoCommunicationError as error:
            raise self._no_reply(error) from error

    def number(self, index: int, number: int = 0) -> int:
        """Return an object as an unsigned number; raises as `read`."""
        return int.from_bytes(self.read(index, number), "little")

    def text(self, index: int) -> str:
        """Return the printable characters of an object; empty if there is none.

        Raises:
            LineFault: As `read`.
        """
        try:
            text = self.read(index).decode("latin-1")
        except SdoRefusedError:
            return ""
        # Some nodes pad texts with zeros or spaces.
        return "".join(character for character in text if character.isprintable()).strip()

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
        return LineFault(DeviceFlag.LATE_REPLY, f"{self._where} does not answer: {error}")
