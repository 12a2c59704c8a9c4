"""The exceptions of the event loop, without a flood of them in the log."""

import asyncio
import errno
from typing import Any, Final

from piezod.daemon.logging import logger

_AGAIN_S: Final = 60.0
_NONE_LEFT: Final = frozenset({errno.EMFILE, errno.ENFILE})

_log = logger("service")


class QuietLoop:
    """Handles exceptions of the event loop: a lack of descriptors is logged once a minute.

    asyncio reports it for each connection that waits, with a traceback, and tries again.
    """

    def __init__(self) -> None:
        self._next_s = 0.0

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Log one exception, or leave it out."""
        error = context.get("exception")
        if not isinstance(error, OSError) or error.errno not in _NONE_LEFT:
            loop.default_exception_handler(context)
        elif loop.time() >= self._next_s:
            self._next_s = loop.time() + _AGAIN_S
            _log.error("no connection accepted", why=error.strerror)
