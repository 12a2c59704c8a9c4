"""Requests to an amplifier of piezosystem jena and its replies, one at a time."""

from functools import partial
from typing import Final

from piezod.devices.bus.conversation import PATIENCE, Conversation, LengthOf
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjProfile

SLOW_FACTOR: Final = 2
"""While a device is opened, its time-out is longer than in the loop by this factor."""


class PsjSession:
    """Sends the commands of a model and reads the replies.

    Every request raises `LineFault` if no reply comes, or the line is lost.

    Args:
        line: The line; its owner opens and closes it.
        timeout_s: Longest wait for a reply, in s.

    Attributes:
        conversation: Requests and replies as bytes.
    """

    def __init__(self, line: Line, profile: PsjProfile, timeout_s: float) -> None:
        self._line, self._profile = line, profile
        self._slow_ns = round(SLOW_FACTOR * timeout_s * 1e9)
        self.conversation = Conversation(line, timeout_s)
        self._frame: LengthOf = codec.framed if profile.frames else codec.line

    def command(self, name: str, channel: int | None = None, *values: float) -> bytes:
        """Return a command, as `codec.command` does."""
        return codec.command(self._profile, name, channel, *values)

    def tell(self, name: str, channel: int | None = None, *values: float) -> None:
        """Send a command that has no reply. Real-time safe."""
        self.conversation.tell(self.command(name, channel, *values))

    def ask(self, name: str, channel: int | None = None, *values: float) -> str:
        """Return the text of the reply to a setting. Real-time safe.

        Raises:
            LineFault: If no reply comes, or it reports an error.
        """
        request = self.command(name, channel, *values)
        fits = partial(codec.is_acknowledgement_of, name)
        return codec.text_of(self.conversation.ask(request, self._frame, fits=fits))

    def value(self, name: str, channel: int | None = None) -> str:
        """Return the only value of the reply to a query. Real-time safe."""
        return self.values(name, channel, 1)[0]

    def is_remote(self, channel: int) -> bool:
        """Return whether the port sets the voltage of an NV40/3 channel. Real-time safe.

        Raises:
            LineFault: If no reply comes, or the firmware does not know the command.
        """
        words = self.values(self._profile.source, channel, 1, answer=codec.SOURCE_REPLY_NV40)
        return codec.is_remote(codec.word(words[0], 10))

    def values(
        self,
        name: str,
        channel: int | None,
        count: int,
        length_of: LengthOf | None = None,
        answer: str = "",
    ) -> list[str]:
        """Return the values of the reply to a query. Real-time safe.

        Args:
            name: The command.
            channel: Number of the channel, None for none.
            count: Required number of values.
            length_of: Finds the end of the reply, if it differs from the usual one.
            answer: First word of the reply, if it differs from the command.
        """
        request = self.command(name, channel)
        named = channel if self._profile.numbered else None
        fits = partial(codec.is_reply_to, answer or name, named)
        frame = self.conversation.ask(request, length_of or self._frame, fits=fits)
        return codec.fields(codec.text_of(frame), answer or name, named, count)

    def indexed(self, name: str, index: int, *others: int) -> list[str]:
        """Return the values behind an index in the reply to a query such as `gbarb,5`.

        Real-time safe.

        Args:
            name: The command.
            index: Its first number, which the reply repeats.
            *others: Further numbers.
        """
        fits = partial(codec.is_reply_to, name, index)
        request = self.command(name, None, index, *others)
        frame = self.conversation.ask(request, self._frame, fits=fits)
        return codec.values_of(codec.text_of(frame), name, index)

    def record(self, name: str, index: int, within_ns: int) -> list[str]:
        """Return the values behind an index in a reply with a whole record."""
        fits = partial(codec.is_reply_to, name, index)
        request = self.command(name, None, index)
        frame = self.conversation.ask(request, codec.framed_record, timeout_ns=within_ns, fits=fits)
        return codec.values_of(codec.text_of(frame), name, index)

    def ask_slowly(
        self, name: str, channel: int | None = None, length_of: LengthOf | None = None
    ) -> bytes:
        """Send a command that may have no reply. Waits long, so not real-time safe.

        Returns:
            The reply, b"" if none came. Then enough time has passed that none can come.
        """
        request, find = self.command(name, channel), length_of or self._frame
        try:
            return self.conversation.ask(request, find, timeout_ns=self._slow_ns)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
        # The silence makes sure that a late reply is not taken for the reply to the next command.
        end_ns = self._line.now_ns() + PATIENCE * self._slow_ns
        while (left_ns := end_ns - self._line.now_ns()) > 0:
            self._line.receive(left_ns)
        self.conversation.give_up()
        return b""
