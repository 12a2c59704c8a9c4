"""The highest rate of a loop with a PI controller."""

from typing import Final

_BITS_PER_BYTE: Final = 10
_REQUEST_BYTES: Final = 32
"""Bytes for one axis in one exchange: position, setpoint and read-back."""
_REPLY_BYTES: Final = 24
_ERROR_BYTES: Final = 7
NETWORK_RATE_HZ: Final = 1000.0
"""An assumption: no public source states how many commands a controller accepts over TCP."""


def wire_rate_hz(baud: int, n_axes: int) -> float:
    """Return the rate in Hz at which the bytes of a cycle fill a serial line."""
    n_bytes = n_axes * (_REQUEST_BYTES + _REPLY_BYTES) + _ERROR_BYTES
    return baud / (_BITS_PER_BYTE * n_bytes)
