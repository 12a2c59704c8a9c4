"""Errors of the connection and of answers, as errors of piezod with a remedy."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from piezod.client.place import Place
from piezod.errors import (
    AmbiguousStageError,
    ClientError,
    NotAllowedError,
    NotRunningError,
    RefusedError,
)

OTHER_VERSION: Final = "check that client and daemon have the same version"
_OF_SERVER: Final[dict[str, type[ClientError]]] = {
    "ambiguous": AmbiguousStageError,
    "not_running": NotRunningError,
}
"""Errors of `piezod web`, which a daemon does not have, by their codes."""


def error_of(status: int, body: bytes) -> ClientError:
    """Return the error of an answer.

    Args:
        status: HTTP status, 400 to 599.
        body: The answer; an error document if the daemon itself answered.
    """
    try:
        error = json.loads(body)["error"]
        code, what, remedy = (str(error.get(key) or "") for key in ("code", "what", "remedy"))
    except (ValueError, LookupError, TypeError, AttributeError):
        return ClientError(f"the daemon answered with HTTP status {status}", OTHER_VERSION)
    if code in _OF_SERVER:
        return _OF_SERVER[code](what, remedy, code)
    if status in (401, 403):
        return NotAllowedError(what, remedy, code)
    if status >= 500 and status not in (503, 504):
        return ClientError(what, remedy, code)
    return RefusedError(what, remedy, code)


@contextmanager
def translated(place: Place) -> Iterator[None]:
    """Raise errors of the connection to a daemon as errors of piezod.

    Raises:
        NotRunningError: If the daemon has ended.
        ClientError: If it does not answer in time, or its certificate is not trusted.
    """
    import httpcore

    try:
        yield
    except httpcore.TimeoutException as error:
        what = f"{place}: the daemon does not answer in time"
        raise ClientError(what, "try again, and look at the log of the daemon") from error
    except httpcore.ConnectError as error:
        raise place.unreachable(error) from error
    except (httpcore.NetworkError, httpcore.ProtocolError) as error:
        raise place.ended() from error


def unexpected(document: object, why: str) -> ClientError:
    """Return the error of an answer with an unexpected form."""
    keys = (
        ", ".join(map(str, document)) if isinstance(document, Mapping) else type(document).__name__
    )
    return ClientError(f"the daemon's answer ({keys}) has an unexpected form: {why}", OTHER_VERSION)
