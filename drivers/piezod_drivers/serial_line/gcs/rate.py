"""How fast a loop over a PI controller can be at all."""

from typing import Final

_BITS_PER_BYTE: Final = 10
_REQUEST_BYTES: Final = 32
"""Of one axis in one exchange: position, drive and read-back are asked for."""
_REPLY_BYTES: Final = 24
_ERROR_BYTES: Final = 7
NETWORK_RATE_HZ: Final = 1000.0
"""No public source tells how many commands a second a controller takes over TCP; a guess."""


def wire_rate_hz(baud: int, n_axes: int) -> float:
    """Return the rate at which the bytes of a cycle fill a serial line, in Hz."""
    n_bytes = n_axes * (_REQUEST_BYTES + _REPLY_BYTES) + _ERROR_BYTES
    return baud / (_BITS_PER_BYTE * n_bytes)
