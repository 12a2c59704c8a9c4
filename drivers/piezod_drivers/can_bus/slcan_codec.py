"""Frames as text, the way serial CAN adapters take and give them ("slcan").

After the LAWICEL CAN232 manual's commands as public sources have them (python-can's `slcan` and the
README of mac-can/SLCAN): `tiiildd…` is a frame with an identifier of 11 bits, `T` with one of 29,
`r` and `R` ask for one, `S0` to `S8` set the bit rate, `O` opens the channel and `C` closes it.
Each ends with CR. An adapter acknowledges with CR (after `z` or `Z` where it acknowledges each
frame) and refuses with BEL.
"""

from binascii import hexlify, unhexlify
from typing import Final

from piezod_drivers.can_bus.frame import EXTENDED_IDS, LONGEST, STANDARD_IDS, Frame

CR: Final = b"\r"
BEL: Final = b"\x07"
_BEL_CR: Final = BEL + CR
OPEN: Final = b"O\r"
CLOSE: Final = b"C\r"
BIT_RATES: Final = {
    10_000: b"S0\r",
    20_000: b"S1\r",
    50_000: b"S2\r",
    100_000: b"S3\r",
    125_000: b"S4\r",
    250_000: b"S5\r",
    500_000: b"S6\r",
    800_000: b"S7\r",
    1_000_000: b"S8\r",
}
"""The command for each bit rate; S7 is 800 kbit/s at LAWICEL and 750 kbit/s at some others."""

_LONGEST_LINE: Final = 32
"""The longest line is an extended frame with eight bytes and a time stamp: 30 characters."""
_STAMP: Final = 2
"""Bytes of a time stamp."""
_KINDS: Final = frozenset(b"tTrR")


def encode(frame: Frame) -> bytes:
    """Return the command that sends a frame; may be called in the loop."""
    number, data, extended, remote = frame
    if remote:
        head = b"R%08X%d\r" if extended else b"r%03X%d\r"
        return head % (number, len(data))
    line = b"T%08X%d%b\r" if extended else b"t%03X%d%b\r"
    return line % (number, len(data), hexlify(data))


def decode(line: bytes) -> Frame | None:
    """Return the frame that a line tells, None where it tells none; may be called in the loop.

    Args:
        line: Without its CR. Never raises, whatever it is.
    """
    if not line or (kind := line[0]) not in _KINDS:
        return None
    extended, remote = kind in b"TR", kind in b"rR"
    try:
        # Identifier and length have 4 digits or, with a leading 0, 10: whole bytes.
        told = unhexlify(b"0" + line[1:] if extended else line[1:])
    except ValueError:
        return None
    n_head = 5 if extended else 2
    head = int.from_bytes(told[:n_head], "big")
    number, length = head >> 4, head & 0xF
    if length > LONGEST or number >= (EXTENDED_IDS if extended else STANDARD_IDS):
        return None
    end = n_head if remote else n_head + length
    if len(told) != end and len(told) != end + _STAMP:
        return None
    return Frame(number, bytes(length) if remote else told[n_head:end], extended, remote)


class SlcanLines:
    """Cuts what an adapter says into lines, BELs among them; keeps no more than one line."""

    def __init__(self) -> None:
        self._rest = b""

    def clear(self) -> None:
        """Forget what has come."""
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Take what has come; return the lines that are complete, and `BEL` for each refusal.

        A BEL that does not begin a line is part of garbage, and refuses nothing.
        """
        lines = (self._rest + data).replace(BEL, _BEL_CR).split(CR)
        self._rest = lines.pop()[-_LONGEST_LINE:]
        return lines
