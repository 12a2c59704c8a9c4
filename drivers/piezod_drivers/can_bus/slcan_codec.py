"""CAN frames as text, as serial CAN adapters send and accept them ("slcan").

The commands are those of the LAWICEL CAN232 manual, from public sources (python-can's `slcan` and
the README of mac-can/SLCAN): `tiiildd…` is a frame with an identifier of 11 bits, `T…` one with 29
bits, `r…` and `R…` are remote frames, `S0` to `S8` set the bit rate, `O` opens the channel and `C`
closes it. Each command ends with CR. An adapter acknowledges with CR (some put `z` or `Z` before it
for a frame) and refuses with BEL. Some end their lines with CR LF, and some echo each command.
"""

from binascii import hexlify, unhexlify
from typing import Final

from piezod_drivers.can_bus.frame import EXTENDED_IDS, MAX_DATA_BYTES, STANDARD_IDS, Frame

CR: Final = b"\r"
BEL: Final = b"\x07"
LF: Final = b"\n"
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
"""The command for each bit rate in bit/s; for some makers S7 is 750 kbit/s, not 800."""

_LONGEST_LINE: Final = 32
"""The longest line, an extended frame with eight bytes and a time stamp, has 30 characters."""
_STAMP: Final = 2
"""Number of bytes of a time stamp."""
_KINDS: Final = frozenset(b"tTrR")


def encode(frame: Frame) -> bytes:
    """Return the command that sends a frame. Real-time safe."""
    number, data, extended, remote = frame
    if remote:
        head = b"R%08X%d\r" if extended else b"r%03X%d\r"
        return head % (number, len(data))
    line = b"T%08X%d%b\r" if extended else b"t%03X%d%b\r"
    return line % (number, len(data), hexlify(data))


def decode(line: bytes) -> Frame | None:
    """Return the frame of a line, None if it is no frame. Real-time safe.

    Args:
        line: Any bytes, without the CR at the end. Never raises.
    """
    if not line or (kind := line[0]) not in _KINDS:
        return None
    extended, remote = kind in b"TR", kind in b"rR"
    try:
        # Identifier and length have 4 digits, or 9 digits and a leading 0: a whole number of bytes.
        raw = unhexlify(b"0" + line[1:] if extended else line[1:])
    except ValueError:
        return None
    n_head = 5 if extended else 2
    head = int.from_bytes(raw[:n_head], "big")
    # The last digit of the head is the length, in both forms.
    number, length = head >> 4, head & 0xF
    if length > MAX_DATA_BYTES or number >= (EXTENDED_IDS if extended else STANDARD_IDS):
        return None
    end = n_head if remote else n_head + length
    # The adapter appends a time stamp if an earlier program has switched that on.
    if len(raw) != end and len(raw) != end + _STAMP:
        return None
    return Frame(number, bytes(length) if remote else raw[n_head:end], extended, remote)


class SlcanLines:
    """Splits the bytes of an adapter into lines and BELs; buffers at most one line."""

    def __init__(self) -> None:
        self._rest = b""

    def clear(self) -> None:
        """Discard the buffered part of a line."""
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes; return the complete lines, and `BEL` for each refusal.

        A BEL inside a line is garbage, not a refusal.
        """
        # A BEL has no CR behind it; with one it becomes a line of its own.
        lines = (self._rest + data).replace(LF, b"").replace(BEL, _BEL_CR).split(CR)
        # Cut, because a device at the wrong bit rate may never send a CR.
        self._rest = lines.pop()[-_LONGEST_LINE:]
        return lines
