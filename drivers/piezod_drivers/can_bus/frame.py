"""CAN frames, and how long they take."""

from typing import Final, NamedTuple

LONGEST: Final = 8
"""Bytes in a frame; CAN FD is not spoken."""
STANDARD_IDS: Final = 1 << 11
EXTENDED_IDS: Final = 1 << 29

# Bits that a frame has beside its data, with the three between frames; and those of them, before
# the end of the checksum, in which the controller may stuff bits (ISO 11898-1).
_STANDARD_BITS: Final = 47
_STANDARD_STUFFED: Final = 34
_EXTENDED_BITS: Final = 67
_EXTENDED_STUFFED: Final = 54


class Frame(NamedTuple):
    """A data frame, or a request for one.

    Attributes:
        id: Identifier: 11 bits, or 29 where extended.
        data: At most eight bytes.
        extended: Whether the identifier has 29 bits.
        remote: Whether it asks for the frame of this identifier and carries no data.
    """

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether it carries data under an identifier of 11 bits; may be called in the loop."""
        return not (self.extended or self.remote)


def most_bits(n_bytes: int, *, extended: bool = False) -> int:
    """Return how many bits a frame takes on the wire at most, those between frames included."""
    bits, stuffed = (
        (_EXTENDED_BITS, _EXTENDED_STUFFED) if extended else (_STANDARD_BITS, _STANDARD_STUFFED)
    )
    return bits + 8 * n_bytes + (stuffed + 8 * n_bytes - 1) // 4
