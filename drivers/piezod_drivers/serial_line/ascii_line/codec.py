"""Lines of text to and from a device, as options describe them; no state, no time."""

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
    filled,
    names_of,
    parsed,
)

TAGS: Final = 1000
"""A command's number goes from 0 to below this, and begins anew."""

_NUMBER: Final = re.compile(
    r"[-+]?(?:\d{1,15}(?:\.\d{0,15})?|\.\d{1,15})(?:[eE][-+]?\d{1,2})?", re.ASCII
)

Found: TypeAlias = Mapping[str, str]
"""What the named groups of a pattern have matched."""
Flagging: TypeAlias = Sequence[tuple[re.Pattern[str], DeviceFlag]]


class Exchange(NamedTuple):
    """A command and its answer.

    Attributes:
        places: The command.
        reply: What the answer must be, None for no answer.
        names: Whose values are in the command or in its answer, but for the tag.
        tagged: Whether the answer names the command by its number.
    """

    places: tuple[Placeholder, ...]
    reply: re.Pattern[str] | None
    names: tuple[str, ...]
    tagged: bool


def exchange(ask: AskConfig) -> Exchange:
    """Compile a command and its answer."""
    reply = None if ask.reply is None else compiled(ask.reply)
    names = [*names_of(ask.send), *(reply.groupindex if reply else ())]
    return Exchange(
        parsed(ask.send),
        reply,
        tuple(dict.fromkeys(name for name in names if name != TAG)),
        reply is not None and TAG in reply.groupindex,
    )


def flagging(configs: Sequence[FlagConfig]) -> Flagging:
    """Compile what lines mean that something is the matter."""
    return [(compiled(config.pattern), DeviceFlag(config.flag)) for config in configs]


class AsciiLines:
    """How lines are made of text, and text of lines.

    Args:
        options: Terminators, encoding, longest answer.
    """

    def __init__(self, options: AsciiFields) -> None:
        self._encoding, self._longest = options.encoding, options.longest_reply
        self._ending = options.terminator.encode(self._encoding)
        self._reply_ending = options.reply_ending.encode(self._encoding)

    def request(self, places: tuple[Placeholder, ...], values: Mapping[str, float]) -> bytes:
        """Return a command with its values and terminator; may be called in the loop."""
        return filled(places, values).encode(self._encoding) + self._ending

    def length(self, got: bytes) -> int:
        """Find a line; a `LengthOf`: garbage is what is longer than an answer can be."""
        end = got.find(self._reply_ending, 0, self._longest + len(self._reply_ending))
        if end >= 0:
            return end + len(self._reply_ending)
        return 0 if len(got) <= self._longest + len(self._reply_ending) else -self._longest

    def text(self, line: bytes) -> str:
        """Return a line without its terminator, and without spaces around it.

        Raises:
            LineFault: `GARBAGE` if it is not in the encoding.
        """
        try:
            return line.removesuffix(self._reply_ending).decode(self._encoding).strip()
        except UnicodeDecodeError as error:
            raise LineFault(DeviceFlag.GARBAGE, f"not {self._encoding}: {line[:40]!r}") from error


def matched(text: str, reply: re.Pattern[str], errors: Flagging) -> Found:
    """Return what the groups of an answer's pattern have matched; may be called in the loop.

    Raises:
        LineFault: What an error means, `GARBAGE` where the line is neither error nor answer.
    """
    for pattern, flag in errors:
        if pattern.fullmatch(text):
            raise LineFault(flag, f"the device says: {text[:80]}")
    found = reply.fullmatch(text)
    if found is None:
        raise LineFault(
            DeviceFlag.GARBAGE, f"an answer like {reply.pattern} was expected, not {text[:80]!r}"
        )
    return found.groupdict("")


def number(text: str) -> float:
    """Read a number; may be called in the loop.

    Raises:
        LineFault: `GARBAGE` if it is none.
    """
    text = text.strip()
    if _NUMBER.fullmatch(text) is None:
        raise LineFault(DeviceFlag.GARBAGE, f"no number came, but {text[:40]!r}")
    return float(text)
