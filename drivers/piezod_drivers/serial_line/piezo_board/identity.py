"""What a board says of itself."""

from math import gcd
from typing import Final, NamedTuple, Self

from piezod.devices.interface import NOT_TOLD, Identity
from piezod.errors import DeviceError
from piezod.units import NS_PER_S

PROTOCOL: Final = 1
_KIND: Final = "piezod-player"
_NUMBERS: Final = (
    *("channels", "memory", "lowest", "highest", "safe"),
    *("clock", "shortest", "longest"),
)


class BoardFacts(NamedTuple):
    """A board, by its reply to `I`."""

    identity: Identity
    channels: int
    memory: int  #: Rows of table and record together.
    lowest: int  #: Lowest code of an output.
    highest: int  #: Highest code of an output.
    safe: int  #: Safe code of an output.
    clock_hz: int  #: Ticks per second.
    shortest: int  #: Ticks between two points.
    longest: int
    waits: int = 0  #: 1 if a play can wait for edges.

    @classmethod
    def of(cls, words: str, where: str) -> Self:
        """Return the facts of a reply.

        Raises:
            DeviceError: If another device has answered, or a firmware with another protocol.
        """
        kind, *parts = words.removeprefix("I ").split(" ")
        known = dict(part.partition("=")[::2] for part in parts)
        if kind != _KIND:
            raise DeviceError(f"{where}: no player board, it says {words!r}; name another port")
        if known.get("protocol") != str(PROTOCOL):
            raise DeviceError(
                f"{where}: its firmware {known.get('firmware')} speaks protocol "
                f"{known.get('protocol')}, allowed: {PROTOCOL}; flash the firmware of this piezod"
            )
        try:
            numbers = [int(known[name]) for name in _NUMBERS]
            numbers.append(int(known.get("edges", 0)))  # firmware 1.0 does not tell it
            name, board, firmware = known["name"], known["board"], known["firmware"]
        except (KeyError, ValueError):
            raise DeviceError(f"{where}: its identity lacks something: {words!r}") from None
        serial = NOT_TOLD if name == "-" else name
        identity = Identity("piezod player", board, serial, firmware)
        return cls(identity, *numbers)

    @property
    def step(self) -> int:
        """Ticks in the smallest number of them that is whole nanoseconds."""
        return self.clock_hz // gcd(self.clock_hz, NS_PER_S)

    def ns(self, ticks: int) -> int:
        """Return the time of a multiple of `step` ticks, in ns."""
        return ticks * NS_PER_S // self.clock_hz
