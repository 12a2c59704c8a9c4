"""CAN frames, and the time that they take on the bus."""

from typing import Final, NamedTuple

MAX_DATA_BYTES: Final = 8
"""Most bytes in a classic frame; CAN FD is not supported."""
STANDARD_IDS: Final = 1 << 11
EXTENDED_IDS: Final = 1 << 29

# Bits of a frame without its data, the three bits between two frames included; and how many of them
# are subject to bit stuffing, which ends with the checksum (ISO 11898-1).
_STANDARD_BITS: Final = 47
_STANDARD_STUFFED: Final = 34
_EXTENDED_BITS: Final = 67
_EXTENDED_STUFFED: Final = 54


class Frame(NamedTuple):
    """A data frame, or a remote frame, which requests a data frame."""

    id: int  #: Identifier: 11 bits, or 29 bits if extended.
    data: bytes = b""  #: At most eight bytes.
    extended: bool = False  #: Whether the identifier has 29 bits.
    remote: bool = False  #: Whether this is a remote frame; `data` then has the requested length.

    @property
    def is_plain(self) -> bool:
        """Whether it is a data frame with an identifier of 11 bits. Real-time safe."""
        return not (self.extended or self.remote)


def max_frame_bits(n_bytes: int, *, extended: bool = False) -> int:
    """Return the highest number of bits of a frame on the bus, inter-frame space included."""
    bits, stuffed = (
        (_EXTENDED_BITS, _EXTENDED_STUFFED) if extended else (_STANDARD_BITS, _STANDARD_STUFFED)
    )
    # After five equal bits the controller stuffs one, which counts as the first of the next five:
    # in the worst case one bit in four.
    return bits + 8 * n_bytes + (stuffed + 8 * n_bytes - 1) // 4
