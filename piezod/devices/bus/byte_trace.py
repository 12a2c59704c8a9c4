"""The bytes on serial ports and TCP connections, for people: as text and as hexadecimal numbers.

Nothing is formatted unless somebody listens: the logger `piezod.bytes` must have the level DEBUG.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

_MOST_SHOWN: Final = 64
"""Number of bytes that an error shows of a longer message."""
_MOST_TRACED: Final = 512
"""Number of bytes that a trace shows; only a sensor that sends by itself exceeds it."""
_LOGGER: Final = logging.getLogger("piezod.bytes")


def shown(data: bytes, most: int = _MOST_SHOWN) -> str:
    r"""Return bytes as text and as hexadecimal numbers, such as `'OK\r' (4F 4B 0D)`."""
    part = data[:most]
    more = f" and {len(data) - len(part)} more" if len(data) > len(part) else ""
    return f"{ascii(part)[1:]} ({part.hex(' ').upper()}){more}"


def trace_sent(where: str, data: bytes) -> None:
    """Report sent bytes to the listeners, if there are any. Real-time safe without listeners."""
    if _LOGGER.isEnabledFor(logging.DEBUG):
        _LOGGER.debug("%s sent %s", where, shown(data, _MOST_TRACED))


def trace_received(where: str, data: bytes) -> None:
    """Report received bytes, as `trace_sent` does. Real-time safe without listeners."""
    if _LOGGER.isEnabledFor(logging.DEBUG):
        _LOGGER.debug("%s got  %s", where, shown(data, _MOST_TRACED))


@contextmanager
def tracing(write: Callable[[str], object]) -> Iterator[None]:
    """Pass a line of text for each transfer of bytes to a function while the block runs.

    Args:
        write: Gets the time, the port, the direction and the bytes.
    """
    handler = _Handler(write)
    level = _LOGGER.level
    _LOGGER.addHandler(handler)
    _LOGGER.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        _LOGGER.setLevel(level)
        _LOGGER.removeHandler(handler)


class _Handler(logging.Handler):
    def __init__(self, write: Callable[[str], object]) -> None:
        super().__init__()
        self._write = write
        self.setFormatter(logging.Formatter("%(asctime)s.%(msecs)03d %(message)s", "%H:%M:%S"))

    def emit(self, record: logging.LogRecord) -> None:
        self._write(self.format(record))
