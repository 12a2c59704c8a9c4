"""The conversation with a player board: outputs and inputs in one exchange."""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.piezo_board import codec
from piezod_drivers.serial_line.piezo_board.codec import CODES, BoardStatus
from piezod_drivers.serial_line.piezo_board.identity import BoardFacts
from piezod_drivers.serial_line.piezo_board.options import BoardOptions
from piezod_drivers.serial_line.piezo_board.player import BoardPlayer

_EXCHANGE_BYTES: Final = 60
_BOARD_S: Final = 0.6e-3
"""Time that a board of 8 bits takes for an exchange, in s."""
_MOST_TO_SAFE: Final = 2000
"""Exchanges in which the outputs must reach the safe voltage."""
_REFUSALS: Final = {
    "crc": DeviceFlag.BAD_CHECKSUM,
    "busy": DeviceFlag.BUSY,
    "off": DeviceFlag.DISCONNECTED,  # it was reset, or its watchdog has tripped
}


class BoardDialogue(BaseDialogue):
    """Implements `ExchangingDialogue`.

    Each request has a tag and a checksum, and so has its reply, which reports outputs, inputs and
    state. A board that has left control, because it was reset or its watchdog tripped, takes no
    setpoint until it is opened and activated again.

    Args:
        wiring: The channels in use: "1", "2".

    Attributes:
        player: Plays tables on the outputs.
    """

    def __init__(self, options: BoardOptions, wiring: Wiring, line: Line) -> None:
        self._conversation = Conversation(line, options.timeout_ms * 1e-3)
        super().__init__(wiring, line, self._conversation)
        self.options, self._line = options, line
        self.inputs = [int(name) - 1 for name in wiring.inputs]
        self.outputs = [int(name) - 1 for name in wiring.outputs]
        self._number = 0
        self._in_control = False
        self._codes: tuple[int, ...] = ()
        self._facts: BoardFacts | None = None
        self.player = BoardPlayer(self)

    def open(self) -> Identity:
        """Connect, and ask what the board is.

        Raises:
            DeviceError: If it is another device, or its firmware has another number of channels.
        """
        self._line.open()
        self._conversation.restart()
        self._forget_in_force()
        self.player.forget()
        self._in_control = False
        with self._conversation.opening():
            # The end of the line ends what another program may have left.
            words = self.ask_words("I", before=b"\n")
        self._conversation.forget_noticed()
        facts = self._facts = BoardFacts.of(words, self._line.where)
        if facts.channels != self.options.channels:
            raise DeviceError(
                f"{self._line.where}: the firmware has {facts.channels} channels, the "
                f"configuration {self.options.channels}: correct `channels`"
            )
        ends = sorted((self.volts(facts.lowest), self.volts(facts.highest)))
        self._ranges = [(ends[0], ends[1])] * len(self.outputs)
        self.ask_status("?")
        return facts.identity

    def capabilities(self) -> Capabilities:
        """Return the channels and the highest rate that the bit rate allows."""
        rate_hz = 1.0 / (_EXCHANGE_BYTES * 10 / self.options.baud + _BOARD_S)
        return Capabilities(
            *self._wiring, True, rate_hz, quality=True, watchdog=True, tells_restart=True
        )

    def activate(self) -> None:
        """Take control of the outputs at their values; a play that is found is stopped.

        Raises:
            DeviceError: If the board refuses.
        """
        if not self.outputs:
            return
        self.ask_status("A")
        self.ask_status(f"W {self.options.watchdog_ms}")
        self.ask_status("ON")
        self._in_control = True

    def deactivate(self) -> None:
        """Let the outputs go to the safe voltage, and wait until they are there."""
        if not self.outputs:
            return
        self._in_control = False
        status = self.ask_status("OFF")
        for _ in range(_MOST_TO_SAFE):
            if all(status.outputs[i] == self.facts.safe for i in self.outputs):
                break
            status = self.ask_status("?")

    def sample(self, now_ns: int) -> Reading:
        """Read every input, in V; NaN at the ends of the range. Real-time safe."""
        return self.reading(self.ask_status("?"), now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set every output, in V. Real-time safe.

        Raises:
            LineFault: If the exchange fails, or the board has left control.
        """
        self._set(values)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set every output and read every input. Real-time safe."""
        return self.reading(self._set(values), now_ns)

    @property
    def facts(self) -> BoardFacts:
        """What the board is; known after `open`."""
        assert self._facts is not None  # noqa: S101 - a bus device opens first
        return self._facts

    def volts(self, code: int) -> float:
        """Return the voltage of an output's code. Real-time safe."""
        low, high = self.options.output_v
        return low + code * (high - low) / CODES

    def ask_status(self, words: str) -> BoardStatus:
        """Send a request and return the status that answers it. Real-time safe.

        Raises:
            LineFault: If the exchange fails, or the board refuses.
        """
        status = codec.status_of(self.ask_words(words), self.options.channels)
        self._codes = status.outputs
        self._note_state(status)
        return status

    def ask_data(self, words: str, data: bytes, n_back: int, timeout_ns: int) -> bytes:
        """Exchange a line and binary data; return the frame of the reply.

        Args:
            words: The request.
            data: What follows when the board is ready for it; b"" for nothing.
            n_back: Bytes behind the line of the reply.
            timeout_ns: Time-out, in ns.
        """
        if not data:
            return self._frame(words, b"", n_back, timeout_ns)
        self._frame(words, b"", 0, timeout_ns)
        tag = codec.tag_of(self._number)  # the reply to the data repeats that of the request
        frame = self._conversation.ask(
            data, codec.reply_length(tag), lambda got: got.startswith(tag), timeout_ns
        )
        self._accepted(codec.words_of(frame, tag))
        return frame

    def reading(self, status: BoardStatus, now_ns: int) -> Reading:
        """Keep the outputs of a status, and return its inputs, in V. Real-time safe."""
        values = [self.input_volts(status.inputs[i]) for i in self.inputs]
        self._keep_in_force(self.in_force_volts(status), now_ns)
        self._flag_saturated(values)
        return now_ns, values

    def input_volts(self, code: int) -> float:
        """Return the voltage of an input's code, NaN at the ends. Real-time safe."""
        low, high = self.options.input_v
        return low + code * (high - low) / CODES if 0 < code < CODES else nan

    def in_force_volts(self, status: BoardStatus) -> list[float]:
        """Return the outputs of a status, in V. Real-time safe."""
        return [self.volts(status.outputs[i]) for i in self.outputs]

    def _ask_in_force(self) -> list[float]:
        return self.in_force_volts(self.ask_status("?"))

    def _set(self, values: Sequence[float]) -> BoardStatus:
        if not self._in_control:
            what = "the board was reset, or its watchdog tripped: it must be taken over again"
            raise LineFault(DeviceFlag.DISCONNECTED, what)
        low, high = self.options.output_v
        codes = list(self._codes)
        for i, value in zip(self.outputs, values, strict=True):
            codes[i] = round((value - low) / (high - low) * CODES)
        self._forget_in_force()
        status = self.ask_status(f"V {' '.join(map(str, codes))}")
        if list(status.outputs) != codes:
            what = f"set to {codes}, the outputs are {status.outputs}"
            raise LineFault(DeviceFlag.LOCAL_MODE, what)
        return status

    def _note_state(self, status: BoardStatus) -> None:
        """Note what has ended the control of a board, once."""
        if "o" in status.flags:
            self._noticed.add(DeviceFlag.GARBAGE)
        if self._in_control and status.state == "off":
            self._in_control = False
            tripped = "w" in status.flags
            self._noticed.add(DeviceFlag.WATCHDOG_TRIPPED if tripped else DeviceFlag.RESTARTED)

    def ask_words(self, words: str, before: bytes = b"") -> str:
        """Send a request and return the words of its reply. Real-time safe."""
        frame = self._frame(words, before, 0, None)
        return codec.words_of(frame, codec.tag_of(self._number))

    def _frame(self, words: str, before: bytes, n_back: int, timeout_ns: int | None) -> bytes:
        self._number = number = (self._number + 1) % codec.TAGS
        tag = codec.tag_of(number)
        frame = self._conversation.ask(
            before + codec.request(number, words),
            codec.reply_length(tag, n_back),
            lambda got: got.startswith(tag),
            timeout_ns,
        )
        self._accepted(codec.words_of(frame, tag))
        return frame

    def _accepted(self, words: str) -> None:
        """Raise `LineFault` if the words of a reply are a refusal."""
        if words.startswith("E "):
            reason = words[2:]
            if reason == "off":
                self._in_control = False
                self._noticed.add(DeviceFlag.RESTARTED)
            flag = _REFUSALS.get(reason, DeviceFlag.WRONG_REQUEST)
            raise LineFault(flag, f"the board refuses: {reason}")
