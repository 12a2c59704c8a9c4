"""Requests and replies of both kinds of cubes."""

from typing import Final

from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Identity
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import AptFrameError, Id
from piezod_drivers.serial_line.thorlabs_apt.filtered_line import FilteredLine
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions

CHANNEL: Final = 1
"""A cube has only this channel."""
_MAKER: Final = "Thorlabs"
_OPENING_NS: Final = 500_000_000
"""Longest time for the identity; the cube has just been woken."""


class AptSession:
    """The exchanges with one cube.

    A reply has the identifier of its kind, but not that of its request. Therefore, after a
    time-out, nothing is requested until the late reply has come or counts as lost. Every request
    raises `LineFault` if no reply comes.

    Attributes:
        line: That line; unrequested messages are set aside.
        conversation: Requests and replies.
    """

    def __init__(self, options: AptOptions, line: Line) -> None:
        self._options = options
        self.line = FilteredLine(line)
        self.conversation = Conversation(self.line, options.timeout_ms * 1e-3)

    def open(self) -> Identity:
        """Connect and identify the cube.

        Raises:
            DeviceUnavailableError: If the port is absent.
            DeviceError: If it is another model.
            LineFault: If the cube does not reply.
        """
        self.line.open()
        self.conversation.restart()
        self.conversation.wait_out()
        # No firmware update follows, and periodic statuses are not wanted. A program before us may
        # have left the cube silent: the acknowledgement makes it send statuses again.
        setup = (Id.NO_FLASH_PROGRAMMING, Id.STOP_UPDATES, Id.ACK_STATUS)
        self.line.send(b"".join(codec.short(ident) for ident in setup))
        self.line.wanted = Id.GET_INFO
        request = codec.short(Id.REQ_INFO)
        # `FilteredLine` passes only complete messages of the wanted identifier.
        with self.conversation.opening():
            frame = self.conversation.ask(request, codec.length_of_whole, timeout_ns=_OPENING_NS)
        hardware = codec.hardware_of(frame)
        if hardware.model != self._options.model:
            found, wanted = hardware.model, self._options.model
            raise DeviceError(f"{self.line.where} leads to {found}, configured is {wanted}")
        self.conversation.forget_noticed()
        self.line.forget_noticed()
        return Identity(_MAKER, hardware.model, str(hardware.serial), hardware.firmware)

    def ask(self, request: bytes, wanted: int) -> bytes:
        """Return the reply to a request. Real-time safe."""
        self.line.wanted = wanted
        return self.conversation.ask(request, codec.length_of_whole)

    def ask_words(self, request: bytes, wanted: int, n: int = 1) -> tuple[int, ...]:
        """Return the first numbers behind the channel in a reply. Real-time safe.

        Raises:
            LineFault: If no reply comes, or it belongs to another channel.
        """
        frame = self.ask(request, wanted)
        try:
            return codec.words_of(frame, CHANNEL, n)
        except AptFrameError as error:
            raise LineFault(DeviceFlag.GARBAGE, str(error)) from error

    def ask_parameter(self, request: int, wanted: int) -> int:
        """Return the parameter of the channel in a reply without data.

        Raises:
            LineFault: If no reply comes, or it belongs to another channel.
        """
        frame = self.ask(codec.short(request, CHANNEL), wanted)
        # The two parameters of a short message.
        channel, value = frame[2], frame[3]
        if channel != CHANNEL:
            raise LineFault(DeviceFlag.GARBAGE, f"channel {channel} instead of {CHANNEL}")
        return value

    def tell(self, message: bytes) -> None:
        """Send a message that has no reply."""
        self.conversation.tell(message)
