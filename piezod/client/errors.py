"""What a failed conversation with a daemon becomes: one of piezod's errors, with a remedy."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from piezod.errors import ClientError, NotAllowedError, NotRunningError, RefusedError

OTHER_VERSION = "are client and daemon of the same version?"


def error_of(status: int, body: bytes) -> ClientError:
    """Return the error that an answer tells.

    Args:
        status: HTTP status, 400 to 599.
        body: The answer, an error document where it is the daemon's.
    """
    try:
        told = json.loads(body)["error"]
        code, what, remedy = (str(told.get(key) or "") for key in ("code", "what", "remedy"))
    except (ValueError, LookupError, TypeError, AttributeError):
        return ClientError(f"the daemon answered with HTTP status {status}", OTHER_VERSION)
    if status in (401, 403):
        return NotAllowedError(what, remedy, code)
    if status >= 500 and status not in (503, 504):
        return ClientError(what, remedy, code)
    return RefusedError(what, remedy, code)


@contextmanager
def translated(socket: Path) -> Iterator[None]:
    """Raise what goes wrong on the way to a daemon, and back, as piezod's errors.

    Args:
        socket: The daemon's socket, for the text.

    Raises:
        ClientError: The more specific ones where that is known.
    """
    import httpx

    try:
        yield
    except httpx.TimeoutException as error:
        what = f"{socket}: the daemon does not answer in time"
        raise ClientError(what, "try again, and look at its log") from error
    except httpx.TransportError as error:
        raise ended(socket) from error


def ended(socket: Path) -> NotRunningError:
    """Return the error of a daemon that has gone after it was found."""
    return NotRunningError(f"{socket}: the daemon has gone", "is it still running?")


def unexpected(document: object, why: str) -> ClientError:
    """Return the error of an answer that does not look as it should."""
    keys = (
        ", ".join(map(str, document)) if isinstance(document, Mapping) else type(document).__name__
    )
    return ClientError(f"the daemon's answer ({keys}) is not understood: {why}", OTHER_VERSION)
