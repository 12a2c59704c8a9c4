"""Questions to an amplifier of piezosystem jena and what they are answered, one at a time."""

from functools import partial
from typing import Final

from piezod.devices.bus.conversation import PATIENCE, Conversation, LengthOf
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjModel

SLOW: Final = 2
"""While a device is opened it may take so many times as long for an answer as in the loop."""


class PsjSession:
    """Asks in the words of a model.

    Args:
        line: The line, opened and closed by whoever owns it.
        model: Which model it is.
        timeout_s: How long to wait for an answer, in s.
    """

    def __init__(self, line: Line, model: PsjModel, timeout_s: float) -> None:
        self._line, self._model, self._timeout_s = line, model, timeout_s
        self._slow_ns = round(SLOW * timeout_s * 1e9)
        self._conversation = Conversation(line, timeout_s)
        self._frame: LengthOf = codec.framed if model.frames else codec.line

    def restart(self) -> None:
        """Begin anew; to be called whenever the line was opened."""
        self._conversation.restart()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, since the last call."""
        return self._conversation.take_noticed()

    def forget_noticed(self) -> None:
        """Forget what came before the device was asked; that is no fault."""
        self._conversation.forget_noticed()

    def command(self, name: str, channel: int | None = None, *values: float) -> bytes:
        """Make a command, as `codec.command` does."""
        return codec.command(self._model, name, channel, *values)

    def tell(self, name: str, channel: int | None = None, *values: float) -> None:
        """Send what is not answered; may be called in the loop.

        Raises:
            LineFault: If it did not go out.
        """
        self._conversation.tell(self.command(name, channel, *values))

    def ask(self, name: str, channel: int | None = None, *values: float) -> str:
        """Return the text of an answer; may be called in the loop.

        Raises:
            LineFault: If none comes, or it tells an error.
        """
        request = self.command(name, channel, *values)
        fits = partial(codec.acknowledges, name)
        return codec.text_of(self._conversation.ask(request, self._frame, fits=fits))

    def value(self, name: str, channel: int | None = None) -> str:
        """Return the one value that a question is answered; may be called in the loop.

        Raises:
            LineFault: If none comes.
        """
        return self.values(name, channel, 1)[0]

    def values(
        self, name: str, channel: int | None, count: int, length_of: LengthOf | None = None
    ) -> list[str]:
        """Return the values that a question is answered; may be called in the loop.

        Args:
            name: The command.
            channel: Of which channel, None for none.
            count: How many values there must be.
            length_of: How the answer ends, if not as usual.

        Raises:
            LineFault: If none come.
        """
        request = self.command(name, channel)
        named = channel if self._model.numbered else None
        fits = partial(codec.tells, name, named)
        frame = self._conversation.ask(request, length_of or self._frame, fits=fits)
        return codec.fields(codec.text_of(frame), name, named, count)

    def ask_once(
        self, name: str, channel: int | None = None, length_of: LengthOf | None = None
    ) -> bytes:
        """Ask what may stay without an answer; waits long and is not for the loop.

        Returns:
            The answer, nothing where none came: then so much time has passed that none can come.

        Raises:
            LineFault: If the line is gone.
        """
        request, find = self.command(name, channel), length_of or self._frame
        try:
            return self._conversation.ask(request, find, timeout_ns=self._slow_ns)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
        end_ns = self._line.now_ns() + PATIENCE * self._slow_ns
        while (left_ns := end_ns - self._line.now_ns()) > 0:
            self._line.receive(left_ns)
        self._conversation = Conversation(self._line, self._timeout_s)
        return b""
