"""The conversation with an MDT amplifier."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.conversation import Conversation, Fits, LengthOf
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.quiet import read_until_quiet
from piezod_drivers.serial_line.thorlabs_mdt.codec import (
    GET_ALL,
    LONG_COMMANDS,
    PUT_ALL,
    SHORT_COMMANDS,
    Replies,
    axes_of,
    has_echo,
    identity_in,
    is_a_model,
    limit_of,
    line_of,
    number_in,
    prompt_in,
    tail_in,
)
from piezod_drivers.serial_line.thorlabs_mdt.nul_free_line import NulFreeLine

MAX_RATE_HZ: Final = 50.0
"""No public source states the speed of the device; clients wait 20 to 50 ms for a command."""
_NO_COMMAND: Final = b"~\r"  # unknown to every model
_FIRST_NS: Final = 500_000_000
_QUIET_NS: Final = 50_000_000
_MOST_CHUNKS: Final = 100
_SECOND_FIRMWARE: Final = 2


class MdtDialogue(BaseDialogue):
    """Implements `Dialogue` for an amplifier that only drives in open loop.

    The protocol of the device is detected when it is opened, by reading until it is quiet; nothing
    is set then. Afterwards a reply is recognized by its end.

    Args:
        timeout_s: Longest wait for each reply in the loop, in s.
        wiring: The channels in use: x, y, z.
    """

    def __init__(self, line: Line, timeout_s: float, wiring: Wiring) -> None:
        self._line, self._outputs = NulFreeLine(line), wiring.outputs
        self._conversation = Conversation(self._line, timeout_s)
        super().__init__(wiring, self._line, self._conversation)
        self._commands, self._replies = LONG_COMMANDS, Replies(b">", b"")
        self._all_axes_at_once = False
        self._echo_is_on = False
        self._echo_is_back = False

    def open(self) -> Identity:
        """Connect, detect the protocol, identify the device and read its limits.

        Raises:
            DeviceError: If it is no MDT, or an axis is missing.
        """
        self._line.open()
        self._conversation.restart()
        self._conversation.wait_out()
        prompt = self._detect_prompt()
        identity = self._detect_identity()
        axes = axes_of(identity.model)
        if missing := [name for name in self._outputs if name not in axes]:
            has, wanted = ", ".join(axes), ", ".join(missing)
            what = f"{identity.model} at {self._line.where} has axes {has}, but not {wanted}"
            raise DeviceError(what)
        reply = self._find_echo()
        if self._echo_is_on:
            reply = self._switch_echo_off()
        if (tail := tail_in(reply)) is None:
            raise DeviceError(f"{self._line.where} reports no voltage: {reply[:80]!r}")
        self._replies = Replies(prompt, tail)
        self._ranges = self._find_ranges()
        # The command sets all three axes, so all three must be in use.
        self._all_axes_at_once = set(self._outputs) == set(axes) != {"x"} and _sets_all_axes(
            identity, prompt
        )
        return identity

    def capabilities(self) -> Capabilities:
        """Return the capabilities: outputs hold and are measured."""
        return Capabilities((), self._outputs, True, MAX_RATE_HZ, holds=True)

    def activate(self) -> None:
        """Switch off the echo of an amplifier that has restarted; its voltage stays."""
        if self._echo_is_back:
            self._switch_echo_off()

    def put(self, values: Sequence[float]) -> None:
        """Set every output. Real-time safe.

        One command sets all axes if the device supports it. Otherwise the axes are set one after
        the other: if the second setting is refused, the first has taken effect, and the read-back
        shows it.
        """
        if self._all_axes_at_once:
            # The wiring may name the axes in another order.
            by_name = dict(zip(self._outputs, values, strict=True))
            self._set(PUT_ALL.format(by_name["x"], by_name["y"], by_name["z"]))
            return
        for name, value in zip(self._outputs, values, strict=True):
            self._set(self._commands.put.format(name.upper(), value))

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Read the measured voltage of each output. Real-time safe."""
        if self._all_axes_at_once:
            by_name = dict(zip("xyz", self._get(GET_ALL, 3), strict=True))
            return [by_name[name] for name in self._outputs]
        return [self._get(self._commands.get.format(name.upper()), 1)[0] for name in self._outputs]

    def _set(self, command: str) -> None:
        request = line_of(command)

        def fits(frame: bytes) -> bool:
            return self._replies.is_acknowledgement(frame, request)

        self._replies.check(self._ask(request, self._replies.acknowledgement_length, fits))

    def _get(self, command: str, n_values: int) -> list[float]:
        def fits(frame: bytes) -> bool:
            return self._replies.has_values(frame, n_values)

        frame = self._ask(line_of(command), self._replies.values_length, fits)
        return self._replies.values(frame, n_values)

    def _ask(self, request: bytes, length_of: LengthOf, fits: Fits) -> bytes:
        frame = self._conversation.ask(request, length_of, fits=fits)
        if not self._echo_is_on and has_echo(frame, request):
            self._echo_is_back = True  # after a restart
            self._noticed.add(DeviceFlag.RESTARTED)
        return frame

    def _find_echo(self) -> bytes:
        """Find out whether the amplifier echoes; return the reply to a query of the voltage."""
        request = line_of(self._commands.get.format("X"))
        reply = self._ask_until_quiet(request)
        self._echo_is_on = has_echo(reply, request)
        return reply

    def _switch_echo_off(self) -> bytes:
        """Switch off the echo, which is on; return the reply to a query of the voltage.

        The command of the A models toggles the echo, so it must not be sent otherwise. Some models
        keep the echo on.
        """
        self._ask_until_quiet(line_of(self._commands.echo_off))
        self._echo_is_back = False
        return self._find_echo()

    def _detect_prompt(self) -> bytes:
        """Send an unknown command; half a command that was sent before becomes part of it."""
        conversation = self._conversation
        try:
            with conversation.opening():
                reply = conversation.ask(_NO_COMMAND, _length_to_prompt, timeout_ns=_FIRST_NS)
        except LineFault as fault:
            if fault.flag is DeviceFlag.LATE_REPLY and conversation.dropped:
                what = f"{self._line.where} does not reply like an MDT: {fault}"
                raise DeviceError(what) from fault
            raise
        reply += read_until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)
        if prompt := prompt_in(reply):
            return prompt
        raise DeviceError(f"{self._line.where} does not reply like an MDT: {reply[:80]!r}")

    def _detect_identity(self) -> Identity:
        # The A models answer `ID?` as well, although they do not know the other long commands.
        for commands in (LONG_COMMANDS, SHORT_COMMANDS):
            reply = self._ask_until_quiet(line_of(commands.identity))
            if identity := identity_in(reply):
                self._commands = SHORT_COMMANDS if is_a_model(identity.model) else commands
                return identity
        raise DeviceError(f"{self._line.where} is no MDT693 or MDT694: {reply[:80]!r}")

    def _find_ranges(self) -> list[tuple[float, float]]:
        commands, limit_v = self._commands, limit_of(self._ask_number(self._commands.limit))
        ranges = []
        for name in self._outputs:
            low_v = self._ask_number(commands.lowest.format(name.upper()))
            high_v = self._ask_number(commands.highest.format(name.upper()))
            # The switch at the back limits every axis, whatever the software limit is.
            ranges.append((low_v, min(high_v, limit_v)))
        return ranges

    def _ask_number(self, command: str) -> float:
        request = line_of(command)
        reply = self._ask_until_quiet(request)
        if (number := number_in(reply, request)) is None:
            raise DeviceError(f"{self._line.where} answers {command} with {reply[:80]!r}")
        return number

    def _ask_until_quiet(self, request: bytes) -> bytes:
        """Send a request and return all bytes that come until the device is quiet."""
        # Discards bytes that came before the request.
        self._line.receive(0)
        self._line.send(request)
        reply = self._line.receive(_FIRST_NS)
        return reply + read_until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)


def _length_to_prompt(got: bytes) -> int:
    return len(got) if prompt_in(got) else 0


def _sets_all_axes(identity: Identity, prompt: bytes) -> bool:
    """Return whether one command sets three axes: from the second firmware on."""
    first = identity.firmware.split(".")[0]
    return prompt == b">" and first.isdecimal() and int(first) >= _SECOND_FIRMWARE
