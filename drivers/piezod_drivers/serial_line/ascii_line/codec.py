"""Lines of text to and from a device, as the options describe them. Pure."""

import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, TypeAlias

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.ascii_line.fields import AsciiFields, AskConfig, FlagConfig
from piezod_drivers.serial_line.ascii_line.patterns import compiled
from piezod_drivers.serial_line.ascii_line.templates import (
    TAG,
    Placeholder,
    fill,
    names_of,
    parsed,
)

TAGS: Final = 1000
"""The running number is below this limit, and then starts at 0 again."""

_NUMBER: Final = re.compile(
    r"[-+]?(?:\d{1,15}(?:\.\d{0,15})?|\.\d{1,15})(?:[eE][-+]?\d{1,2})?", re.ASCII
)

Found: TypeAlias = Mapping[str, str]
"""Texts that the named groups of a pattern have matched."""
FlagPatterns: TypeAlias = Sequence[tuple[re.Pattern[str], DeviceFlag]]


class Exchange(NamedTuple):
    """A compiled command and its reply."""

    places: tuple[Placeholder, ...]  #: The placeholders of the command.
    reply: re.Pattern[str] | None  #: Pattern of the reply, None if there is none.
    names: tuple[str, ...]  #: Channels whose values are in the command or in its reply.
    tagged: bool  #: Whether the reply repeats the running number of the command.


def compiled_exchange(ask: AskConfig) -> Exchange:
    """Compile a command and its reply."""
    reply = None if ask.reply is None else compiled(ask.reply)
    names = [*names_of(ask.send), *(reply.groupindex if reply else ())]
    return Exchange(
        parsed(ask.send),
        reply,
        tuple(dict.fromkeys(name for name in names if name != TAG)),
        reply is not None and TAG in reply.groupindex,
    )


def compiled_flags(configs: Sequence[FlagConfig]) -> FlagPatterns:
    """Compile the patterns of lines that report faults."""
    return [(compiled(config.pattern), DeviceFlag(config.flag)) for config in configs]


class AsciiLines:
    """Converts text to lines, and lines to text.

    Args:
        options: Terminators, encoding, length of the longest reply.
    """

    def __init__(self, options: AsciiFields) -> None:
        self._encoding, self._longest = options.encoding, options.longest_reply
        self._ending = options.terminator.encode(self._encoding)
        self._reply_ending = options.reply_ending.encode(self._encoding)

    def request(self, places: tuple[Placeholder, ...], values: Mapping[str, float]) -> bytes:
        """Return a command with its values and terminator. Real-time safe."""
        return fill(places, values).encode(self._encoding) + self._ending

    def length(self, got: bytes) -> int:
        """Return the length of a line, as a `LengthOf`; a longer one is garbage. Real-time safe."""
        # Searched only so far: a device that never ends a line must not cost more time with every
        # call.
        end = got.find(self._reply_ending, 0, self._longest + len(self._reply_ending))
        if end >= 0:
            return end + len(self._reply_ending)
        return 0 if len(got) <= self._longest + len(self._reply_ending) else -self._longest

    def text(self, line: bytes) -> str:
        """Return a line without terminator and surrounding spaces. Real-time safe.

        Raises:
            LineFault: `GARBAGE` if it is not in the encoding.
        """
        try:
            return line.removesuffix(self._reply_ending).decode(self._encoding).strip()
        except UnicodeDecodeError as error:
            raise LineFault(DeviceFlag.GARBAGE, f"not {self._encoding}: {line[:40]!r}") from error


def match_reply(text: str, reply: re.Pattern[str], errors: FlagPatterns) -> Found:
    """Return the texts of the groups in a reply. Real-time safe.

    Raises:
        LineFault: The fault of an error line; `GARBAGE` if the line is neither error nor reply.
    """
    # Errors first: the pattern of a reply may be so wide that it also matches an error line.
    for pattern, flag in errors:
        if pattern.fullmatch(text):
            raise LineFault(flag, f"the device reports: {text[:80]}")
    found = reply.fullmatch(text)
    if found is None:
        raise LineFault(
            DeviceFlag.GARBAGE, f"expected a reply like {reply.pattern}, got {text[:80]!r}"
        )
    return found.groupdict("")


def number(text: str) -> float:
    """Return the number in a text. Real-time safe.

    Raises:
        LineFault: `GARBAGE` if it is not a number.
    """
    text = text.strip()
    if _NUMBER.fullmatch(text) is None:
        raise LineFault(DeviceFlag.GARBAGE, f"expected a number, got {text[:40]!r}")
    return float(text)
