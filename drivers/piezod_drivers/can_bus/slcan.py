"""Frames as text, the way serial CAN adapters take and give them ("slcan").

After the LAWICEL CAN232 manual's commands as public sources have them (python-can's `slcan` and the
README of mac-can/SLCAN): `tiiildd…` is a frame with an identifier of 11 bits, `T` with one of 29,
`r` and `R` ask for one, `S0` to `S8` set the bit rate, `O` opens the channel and `C` closes it.
Each ends with CR. An adapter acknowledges with CR (after `z` or `Z` where it acknowledges each
frame) and refuses with BEL.
"""

from typing import Final

from piezod_drivers.can_bus.frame import EXTENDED_IDS, LONGEST, STANDARD_IDS, Frame

CR: Final = b"\r"
BEL: Final = b"\x07"
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
_HEX: Final = frozenset(b"0123456789ABCDEFabcdef")
_DIGITS: Final = {ord("t"): 3, ord("r"): 3, ord("T"): 8, ord("R"): 8}
_STAMP: Final = 4


def encode(frame: Frame) -> bytes:
    """Return the command that sends a frame; may be called in the loop."""
    if frame.remote:
        head = b"R%08X%d\r" if frame.extended else b"r%03X%d\r"
        return head % (frame.id, len(frame.data))
    head = b"T%08X%d" if frame.extended else b"t%03X%d"
    return head % (frame.id, len(frame.data)) + frame.data.hex().encode() + CR


def decode(line: bytes) -> Frame | None:
    """Return the frame that a line tells, None where it tells none; may be called in the loop.

    Args:
        line: Without its CR. Never raises, whatever it is.
    """
    if not line or (n_digits := _DIGITS.get(line[0])) is None:
        return None
    end = 1 + n_digits
    if len(line) <= end or not _HEX.issuperset(line[1:]):
        return None
    number, length = int(line[1:end], 16), line[end] - 48
    extended, remote = n_digits == 8, line[0] in b"rR"
    if not 0 <= length <= LONGEST or number >= (EXTENDED_IDS if extended else STANDARD_IDS):
        return None
    data = line[end + 1 :]
    n_hex = 0 if remote else 2 * length
    if len(data) not in {n_hex, n_hex + _STAMP}:
        return None
    payload = bytes(length) if remote else bytes.fromhex(data[:n_hex].decode())
    return Frame(number, payload, extended, remote)


class Lines:
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
        *ended, rest = (self._rest + data).replace(BEL, BEL + CR).split(CR)
        self._rest = rest if len(rest) <= _LONGEST_LINE else rest[-_LONGEST_LINE:]
        return ended
