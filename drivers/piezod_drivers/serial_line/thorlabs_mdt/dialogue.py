"""What is said to an MDT amplifier."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.conversation import Conversation, Fits, LengthOf
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError
from piezod_drivers.serial_line.quiet import until_quiet
from piezod_drivers.serial_line.thorlabs_mdt.codec import (
    GET_ALL,
    LONG,
    PUT_ALL,
    SHORT,
    Replies,
    axes_of,
    identity_in,
    line_of,
    number_in,
    prompt_in,
    tail_in,
)

MAX_RATE_HZ: Final = 50.0
"""No public source tells how fast it obeys; those who drive it wait 20 to 50 ms for it."""
_NO_COMMAND: Final = b"~\r"
_FIRST_NS: Final = 500_000_000
_QUIET_NS: Final = 50_000_000
_MOST_CHUNKS: Final = 100
_SECOND_FIRMWARE: Final = 2


class MdtDialogue:
    """Implements `Dialogue` for an amplifier that drives in open loop and cannot do anything else.

    How the device talks is found out when it is opened, by listening until it is quiet; nothing is
    set then. Afterwards a reply is known by its end.

    Args:
        line: The line.
        timeout_s: How long to wait for each reply in the loop, in s.
        wiring: The channels that are used: x, y, z.
    """

    def __init__(self, line: Line, timeout_s: float, wiring: Wiring) -> None:
        self._line, self._outputs = line, wiring.outputs
        self._conversation = Conversation(line, timeout_s)
        self._words, self._replies = LONG, Replies(b">", b"")
        self._at_once = False
        self._silent = True
        self._restarted: set[DeviceFlag] = set()
        self._ranges: list[tuple[float, float]] = []
        self._flags = [NO_FLAGS] * len(wiring.outputs)

    def open(self) -> Identity:
        """Connect, find out how the device talks, who it is and how far it drives.

        Raises:
            DeviceUnavailableError: If the port is absent or held.
            DeviceError: If it is no MDT, or has no such axis.
            LineFault: If nobody answers.
        """
        self._line.open()
        self._conversation.restart()
        self._conversation.wait_out()
        prompt = self._find_prompt()
        identity = self._find_identity()
        axes = axes_of(identity.model)
        if missing := [name for name in self._outputs if name not in axes]:
            has, wanted = ", ".join(axes), ", ".join(missing)
            what = f"{identity.model} at {self._line.where} has axes {has}, not {wanted}"
            raise DeviceError(what)
        self._listen(line_of(self._words.echo_off))
        request = line_of(self._words.get.format("X"))
        told = self._listen(request)
        self._silent = not told.startswith(request)
        if (tail := tail_in(told)) is None:
            raise DeviceError(f"{self._line.where} tells no voltage: {told[:80]!r}")
        self._replies = Replies(prompt, tail)
        self._ranges = self._find_ranges()
        self._at_once = set(self._outputs) == set(axes) != {"x"} and _knows_all(identity, prompt)
        return identity

    def close(self) -> None:
        """Let go of the line; outputs stay as they are. Never raises."""
        self._line.close()

    def capabilities(self) -> Capabilities:
        """Tell what the amplifier can do: it holds its outputs, and measures them."""
        return Capabilities((), self._outputs, True, MAX_RATE_HZ, holds=True)

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the lowest and the highest voltage of each output."""
        return self._ranges

    def activate(self) -> None:
        """Do nothing: the amplifier obeys always, and keeps the voltage that it has."""

    def deactivate(self) -> None:
        """Do nothing: the outputs hold."""

    def sample(self, now_ns: int) -> Reading:
        """Return nothing: it has no sensor."""
        return now_ns, ()

    def put(self, values: Sequence[float]) -> None:
        """Set every output; may be called in the loop.

        With all axes at once where the device can, else one after the other: should the second be
        refused, the first has been set, and the read-back shows it.
        """
        if self._at_once:
            by_name = dict(zip(self._outputs, values, strict=True))
            self._set(PUT_ALL.format(by_name["x"], by_name["y"], by_name["z"]))
            return
        for name, value in zip(self._outputs, values, strict=True):
            self._set(self._words.put.format(name.upper(), value))

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Ask for the measured voltage of each output; may be called in the loop."""
        if self._at_once:
            by_name = dict(zip("xyz", self._get(GET_ALL, 3), strict=True))
            return [by_name[name] for name in self._outputs]
        return [self._get(self._words.get.format(name.upper()), 1)[0] for name in self._outputs]

    def flags(self) -> Sequence[Flags]:
        """Tell nothing: the amplifier has no status."""
        return self._flags

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong on the line without making an exchange fail; and forget it."""
        restarted, self._restarted = self._restarted, set()
        return self._conversation.take_noticed() | restarted

    def _set(self, command: str) -> None:
        request = line_of(command)

        def fits(frame: bytes) -> bool:
            return self._replies.is_taken(frame, request)

        self._replies.check(self._ask(request, self._replies.taken_length, fits))

    def _get(self, command: str, n_values: int) -> list[float]:
        def fits(frame: bytes) -> bool:
            return self._replies.tells(frame, n_values)

        frame = self._ask(line_of(command), self._replies.values_length, fits)
        return self._replies.values(frame, n_values)

    def _ask(self, request: bytes, length_of: LengthOf, fits: Fits) -> bytes:
        frame = self._conversation.ask(request, length_of, fits=fits)
        if self._silent and frame.startswith(request):  # it has forgotten that it shall not repeat
            self._restarted.add(DeviceFlag.RESTARTED)
        return frame

    def _find_prompt(self) -> bytes:
        """Send what is no command; half a request that was sent before is none with it either."""
        told = self._listen(_NO_COMMAND)
        if not told:
            raise LineFault(DeviceFlag.LATE_REPLY, f"no reply within {_FIRST_NS / 1e6:g} ms")
        if prompt := prompt_in(told):
            return prompt
        raise DeviceError(f"{self._line.where} does not answer as an MDT does: {told[:80]!r}")

    def _find_identity(self) -> Identity:
        for words in (LONG, SHORT):
            told = self._listen(line_of(words.identity))
            if identity := identity_in(told):
                self._words = words
                return identity
        raise DeviceError(f"{self._line.where} is no MDT693 or MDT694: {told[:80]!r}")

    def _find_ranges(self) -> list[tuple[float, float]]:
        words, limit_v = self._words, self._ask_number(self._words.limit)
        ranges = []
        for name in self._outputs:
            low_v = self._ask_number(words.lowest.format(name.upper()))
            high_v = self._ask_number(words.highest.format(name.upper()))
            ranges.append((low_v, min(high_v, limit_v)))
        return ranges

    def _ask_number(self, command: str) -> float:
        request = line_of(command)
        told = self._listen(request)
        if (number := number_in(told, request)) is None:
            raise DeviceError(f"{self._line.where} answers {command} with {told[:80]!r}")
        return number

    def _listen(self, request: bytes) -> bytes:
        """Send something and return all that comes until the device is quiet."""
        self._line.receive(0)
        self._line.send(request)
        told = self._line.receive(_FIRST_NS)
        return told + until_quiet(self._line, _QUIET_NS, _MOST_CHUNKS)


def _knows_all(identity: Identity, prompt: bytes) -> bool:
    """Tell whether it sets three axes by one command: from the second firmware on."""
    first = identity.firmware.split(".")[0]
    return prompt == b">" and first.isdecimal() and int(first) >= _SECOND_FIRMWARE
