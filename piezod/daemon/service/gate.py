"""The first checks of a request: no foreign web page, and limits of rate and connections.

A browser cannot reach the socket, unless somebody forwards it to a TCP port, as with `ssh -L`. Then
any page could arm the stage: a POST without a body is a simple request, which a browser sends
across origins without asking the server. Other programs than browsers are not restricted.
"""

from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from piezod.config.origins import is_own_host, is_same_origin
from piezod.daemon.service.access import RateLimit
from piezod.daemon.service.answers import ForeignPageError, TooManyError, error_answer
from piezod.daemon.service.connection import PeerProtocol, connection_of
from piezod.daemon.service.route import URGENT
from piezod.daemon.stage.errors import StageError

_READS: Final = ("GET", "HEAD")
_OWN_SITES: Final = ("none", "same-origin")


def refuse_foreign_page(scope: Scope) -> None:
    """Check where a request comes from.

    Raises:
        ForeignPageError: If a page of a foreign site may have sent it.
    """
    headers = Headers(scope=scope)
    host, origin = headers.get("host", ""), headers.get("origin")
    if not is_own_host(host):
        what = f"Host {host[:64]!r} has a domain name, allowed: an address, or a name without a dot"
        raise ForeignPageError(what, "use localhost or 127.0.0.1 in the address")
    if origin is not None and not is_same_origin(origin, host):
        what = f"Origin {origin[:64]!r} is a foreign page, allowed: programs"
        raise ForeignPageError(what, _USE_WEB)
    if headers.get("sec-fetch-site", "none") not in _OWN_SITES:
        raise ForeignPageError("a foreign page has sent this request", _USE_WEB)
    if scope["method"] not in _READS and _is_browser(headers) and not _is_asked_before(headers):
        what = "a browser must send the header X-Piezod-Client, or the content type JSON"
        raise ForeignPageError(what, _USE_WEB)


_USE_WEB: Final = "for a page in a browser run `piezod web`"


def _is_browser(headers: Headers) -> bool:
    """Return whether a browser sends the request; a page cannot change these headers."""
    agent = headers.get("user-agent", "")
    return agent.startswith("Mozilla/") or "origin" in headers or "sec-fetch-site" in headers


def _is_asked_before(headers: Headers) -> bool:
    """Return whether a browser asks the server before it sends this across origins."""
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    return "x-piezod-client" in headers or kind == "application/json"


_MALFORMED = (400, 413, 415, 422)


class Gate:
    """Refuses requests of foreign web pages, and limits all others by rate and by connection.

    Requests towards safety have no limits.

    Args:
        app: The application behind the gate.
        rate_limit: Limits the rate of requests.
    """

    def __init__(self, app: ASGIApp, rate_limit: RateLimit) -> None:
        self._app, self._rate_limit = app, rate_limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Admit one request to the application, or refuse it."""
        connection = connection_of(scope)
        try:
            self._admit(scope, connection)
        except StageError as error:
            await error_answer(error)(scope, receive, send)
            return

        async def send_checked(message: Message) -> None:
            if message["type"] == "http.response.start":
                _close_if_needed(message, connection)
            await send(message)

        await self._app(scope, receive, send_checked)

    def _admit(self, scope: Scope, connection: PeerProtocol) -> None:
        process = connection.credentials.uid, connection.credentials.pid
        refuse_foreign_page(scope)
        if (scope["method"], scope["path"]) in URGENT:
            return
        if connection.crowded:
            most = connection.limits.per_user
            what = f"this user has more than {most} connections; the others can only stop the stage"
            raise TooManyError(what, "close some connections")
        if not self._rate_limit.admit(process):
            what = "too many requests, allowed: 50/s for one process and 200/s for all"
            raise TooManyError(
                what,
                "send fewer requests; GET /v1/telemetry and POST /v1/stream are one request each",
            )


def _close_if_needed(start: Message, connection: PeerProtocol) -> None:
    """Close a connection after an answer to an incomplete body, or to the tenth bad request."""
    too_many_bad = start["status"] in _MALFORMED and connection.note_bad_request()
    if too_many_bad or connection.receiving:
        start["headers"] = [*start["headers"], (b"connection", b"close")]
