"""What amplifiers and strain gauge readers have in common in talking."""

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
"""A cube has one."""
_MAKER: Final = "Thorlabs"
_OPENING_NS: Final = 500_000_000
"""How long it may take a cube that has just been woken to say who it is."""


class Cube:
    """One cube at the end of a line.

    Replies do not tell which request they answer, only of which kind it was: after a time-out
    nothing is asked until the late reply has come or can no longer come.

    Args:
        options: What a configuration says.
        line: The line to the cube.
    """

    def __init__(self, options: AptOptions, line: Line) -> None:
        self._options = options
        self.line = FilteredLine(line)
        self._conversation = Conversation(self.line, options.timeout_ms * 1e-3)

    def open(self) -> Identity:
        """Connect, and ask who is there.

        Raises:
            DeviceUnavailableError: If nobody is there.
            DeviceError: If it is another model.
            LineFault: If nobody answers.
        """
        self.line.open()
        self._conversation.restart()
        self._conversation.wait_out()
        self.line.send(codec.short(Id.NO_FLASH_PROGRAMMING) + codec.short(Id.STOP_UPDATES))
        self.line.wanted = Id.GET_INFO
        request = codec.short(Id.REQ_INFO)
        frame = self._conversation.ask(request, codec.length_of_whole, timeout_ns=_OPENING_NS)
        hardware = codec.hardware_of(frame)
        if hardware.model != self._options.model:
            told, wanted = hardware.model, self._options.model
            raise DeviceError(
                f"{self.line.where} leads to a {told}, the configuration says {wanted}"
            )
        self._conversation.forget_noticed()
        self.line.forget_noticed()
        return Identity(_MAKER, hardware.model, str(hardware.serial), hardware.firmware)

    def close(self) -> None:
        """Let go of the line. Never raises."""
        self.line.close()

    def ask(self, request: bytes, wanted: int) -> bytes:
        """Return the message that answers a request; may be called in the loop.

        Raises:
            LineFault: If none comes.
        """
        self.line.wanted = wanted
        return self._conversation.ask(request, codec.length_of_whole)

    def answers(self, request: bytes, wanted: int) -> bool:
        """Tell whether a request is answered, whose late answer nobody would take for another.

        Raises:
            LineFault: If it cannot be sent.
        """
        self.line.wanted = wanted
        try:
            self._conversation.ask(request, codec.length_of_whole, lambda _frame: True)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
            return False
        return True

    def ask_words(self, request: bytes, wanted: int, n: int = 1) -> tuple[int, ...]:
        """Return the first numbers after the channel in an answer; may be called in the loop.

        Raises:
            LineFault: If no answer comes, or it is another channel's.
        """
        frame = self.ask(request, wanted)
        try:
            return codec.words_of(frame, CHANNEL, n)
        except AptFrameError as error:
            raise LineFault(DeviceFlag.GARBAGE, str(error)) from error

    def ask_parameter(self, request: int, wanted: int) -> int:
        """Return what an answer without data tells of the channel.

        Raises:
            LineFault: If no answer comes, or it is another channel's.
        """
        frame = self.ask(codec.short(request, CHANNEL), wanted)
        channel, value = frame[2], frame[3]
        if channel != CHANNEL:
            raise LineFault(DeviceFlag.GARBAGE, f"of channel {channel}, not {CHANNEL}")
        return value

    def tell(self, message: bytes) -> None:
        """Send what has no answer.

        Raises:
            LineFault: If it cannot be sent.
        """
        self._conversation.tell(message)

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail; and forget it."""
        return self._conversation.take_noticed()
