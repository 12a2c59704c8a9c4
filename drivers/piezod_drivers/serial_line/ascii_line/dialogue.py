"""The conversation with a device that speaks in lines of text, as the options describe it."""

import re
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue, StatusTurns
from piezod.devices.bus.byte_trace import shown
from piezod.devices.bus.conversation import Conversation, Fits
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import UNKNOWN, Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.ascii_line.codec import (
    TAGS,
    AsciiLines,
    Exchange,
    Found,
    compiled_exchange,
    compiled_flags,
    match_reply,
    number,
)
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions
from piezod_drivers.serial_line.ascii_line.templates import TAG, parsed
from piezod_drivers.serial_line.quiet import read_until_quiet

_ANY_TEXT: Final = re.compile(".*", re.DOTALL)
_NO_COMMAND: Final = parsed("~")  # makes half a command before it an unknown one
_QUIET_NS: Final = 100_000_000
_MOST_CHUNKS: Final = 20
_MOST_UNASKED: Final = 3
"""After this number of setpoints in a row whose command was answered without a `reply`, the next
activation is refused: a `reply` is missing in the configuration."""


class AsciiDialogue(BaseDialogue):
    """Implements `Dialogue` for a device that replies to commands.

    Args:
        line: The line, not open.
        options: Valid options.
    """

    def __init__(self, line: Line, options: AsciiOptions, wiring: Wiring) -> None:
        self._conversation = Conversation(line, options.timeout_ms * 1e-3)
        super().__init__(wiring, line, self._conversation)
        self._line, self._options = line, options
        self._lines = AsciiLines(options)
        self._errors = compiled_flags(options.errors)
        # Only commands that concern channels in use are sent.
        self._set = _serving([compiled_exchange(ask) for ask in options.set], wiring.outputs)
        self._read = _serving([compiled_exchange(ask) for ask in options.read], wiring.inputs)
        self._read_back = _serving(
            [compiled_exchange(ask) for ask in options.read_back], wiring.outputs
        )
        # `start` and `stop` may change outputs, modes or loops.
        only_read = bool(options.outputs) and not wiring.outputs  # e.g. `piezod probe`
        self._start = [] if only_read else [compiled_exchange(ask) for ask in options.start]
        self._stop = [] if only_read else [compiled_exchange(ask) for ask in options.stop]
        used = [options.outputs[name] for name in wiring.outputs]
        self._ranges = [(output.lowest, output.highest) for output in used]
        self._tolerances = {name: output.tolerance for name, output in options.outputs.items()}
        status = options.status
        self._turns = StatusTurns(0 if status is None else round(status.every_ms * 1e6))
        self._status_places = () if status is None else parsed(status.send)
        self._status_flags = () if status is None else compiled_flags(status.flags)
        self._half_sent = False
        self._tags = count()
        self._dropped = b""
        self._unasked, self._n_unasked = b"", 0  # answers to setpoints that have no `reply`

    def open(self) -> Identity:
        """Connect and identify the device, if the options have a command for it.

        Raises:
            DeviceError: If another device replies, or a command would set a channel of no axis.
        """
        for exchange in self._set:
            # The value of a channel of no axis is unknown, and any other value would be a jump.
            if unused := [name for name in exchange.names if name not in self._wiring.outputs]:
                what = f"a command also sets channel {unused[0]}, which no axis uses"
                raise DeviceError(f"{what}: use it in an axis, or write its value into the command")
        self._line.open()
        self._conversation.restart()
        self._end_half_command()
        self._flags = self._no_flags
        if self._options.identify is None:
            return Identity(UNKNOWN, f"device at {self._line.where}", UNKNOWN, UNKNOWN)
        self._conversation.wait_out()
        try:
            with self._conversation.opening():
                found = self._exchange(compiled_exchange(self._options.identify), {})
        except LineFault as fault:
            if fault.flag is DeviceFlag.LATE_REPLY and self._conversation.dropped:
                raise DeviceError(f"{self._line.where} is another device: {fault}") from fault
            raise
        values_read = [found.get(name, "").strip() or UNKNOWN for name in Identity._fields]
        return Identity(*values_read)

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the options."""
        return Capabilities(
            inputs=self._wiring.inputs,
            outputs=self._wiring.outputs,
            read_back=bool(self._read_back),
            max_rate_hz=self._options.max_rate_hz,
            holds=True,
        )

    def activate(self) -> None:
        """Send the commands of `start`.

        Raises:
            DeviceError: If the device has answered setpoints whose command has no `reply`.
        """
        if self._n_unasked >= _MOST_UNASKED:
            self._n_unasked = 0  # refused once: the bytes may have been noise after all
            what = f"{self._line.where}: the device answered setpoints by {shown(self._unasked)}"
            raise DeviceError(f"{what}, but their command has no `reply`: give it one")
        for exchange in self._start:
            self._exchange(exchange, {})

    def deactivate(self) -> None:
        """Send the commands of `stop`."""
        for exchange in self._stop:
            self._exchange(exchange, {})

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe."""
        values_read = self._numbers(self._read, self._wiring.inputs)
        self._poll_status()
        return now_ns, [values_read[name] for name in self._wiring.inputs]

    def put(self, values: Sequence[float]) -> None:
        """Set every output; without a reply, read the outputs back. Real-time safe.

        Raises:
            LineFault: If an exchange fails; `LOCAL_MODE` if another setpoint is read back.
        """
        named = dict(zip(self._wiring.outputs, values, strict=True))
        answered = True
        for exchange in self._set:
            self._exchange(exchange, named)
            answered &= exchange.reply is not None
        # Without a reply nothing confirms that the device received the setpoint.
        if not answered:
            self._dropped = b""
            values_read = self._numbers(self._read_back, self._wiring.outputs)
            self._unasked = self._dropped
            self._n_unasked = self._n_unasked + 1 if self._unasked else 0
            self._check_setpoints(named, values_read)
        self._poll_status()

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - it is asked every time
        """Read back every output. Real-time safe."""
        values_read = self._numbers(self._read_back, self._wiring.outputs)
        return [values_read[name] for name in self._wiring.outputs]

    def _numbers(self, exchanges: Sequence[Exchange], channels: Sequence[str]) -> dict[str, float]:
        values_read = {}
        for exchange in exchanges:
            found = self._exchange(exchange, {})
            values_read.update(
                {name: number(found[name]) for name in exchange.names if name in channels}
            )
        return values_read

    def _check_setpoints(
        self, wanted: Mapping[str, float], values_read: Mapping[str, float]
    ) -> None:
        for name, value in wanted.items():
            tolerance = self._tolerances[name]
            if tolerance is not None and abs(values_read[name] - value) > tolerance:
                what = f"{name} was set to {value:g}, reads back {values_read[name]:g}: not obeyed"
                raise LineFault(DeviceFlag.LOCAL_MODE, what)

    def _exchange(self, exchange: Exchange, values: Mapping[str, float]) -> Found:
        """Send a command and return the texts of the groups in its reply. Real-time safe.

        Args:
            exchange: The command and its reply.
            values: Values for the command.

        Raises:
            LineFault: If the reply is missing or does not match.
        """
        tag = next(self._tags) % TAGS
        request = self._lines.request(exchange.places, {**values, TAG: tag})
        reply = exchange.reply
        if reply is None:
            self._tell(request)
            return {}

        def fits(line: bytes) -> bool:
            try:
                found = match_reply(self._lines.text(line), reply, self._errors)
            except LineFault as fault:
                return fault.flag is not DeviceFlag.GARBAGE
            return not exchange.tagged or (
                found[TAG].strip().isdecimal() and int(found[TAG]) == tag
            )

        # With a running number a line that does not fit is a late reply, and the wait goes on.
        # Without it, it counts as garbage.
        is_reply = fits if exchange.tagged else None
        line = self._ask(request, is_reply, fits)
        return match_reply(self._lines.text(line), reply, self._errors)

    def _ask(self, request: bytes, is_reply: Fits | None = None, fits: Fits | None = None) -> bytes:
        try:
            return self._conversation.ask(request, self._lines.length, is_reply, fits=fits)
        except LineFault as fault:
            self._half_sent |= fault.flag is DeviceFlag.PARTIAL_WRITE
            raise
        finally:
            self._dropped = self._dropped or self._conversation.dropped

    def _tell(self, request: bytes) -> None:
        try:
            self._conversation.tell(request)
        except LineFault as fault:
            self._half_sent |= fault.flag is DeviceFlag.PARTIAL_WRITE
            raise

    def _end_half_command(self) -> None:
        """Make half a command that was sent an unknown one, and discard its reply."""
        if self._half_sent:
            self._line.send(self._lines.request(_NO_COMMAND, {}))
            self._half_sent = False
            read_until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)

    def _poll_status(self) -> None:
        """Read the status if it is due; never before a setpoint."""
        if not self._status_flags or self._turns.due(self._line.now_ns()) is None:
            return
        request = self._lines.request(self._status_places, {TAG: next(self._tags) % TAGS})
        try:
            text = self._lines.text(self._ask(request))
            match_reply(text, _ANY_TEXT, self._errors)
        except LineFault as fault:
            self._note_unless_lost(fault)
            return
        flags = frozenset(flag for pattern, flag in self._status_flags if pattern.fullmatch(text))
        self._flags = [flags] * len(self._no_flags)  # a status names no channel


def _serving(exchanges: Sequence[Exchange], channels: Sequence[str]) -> list[Exchange]:
    """Return the exchanges that concern one of these channels."""
    return [exchange for exchange in exchanges if set(exchange.names) & set(channels)]
