"""Who may use the page: the checks of every request and every WebSocket, before anything else."""

import secrets
from collections.abc import Container
from typing import Final
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from piezod.config.origins import host_name, is_own_host, is_same_origin

METRICS: Final = "/metrics"
_HOW: Final = (
    "refused: the token is missing, or is not that of this start. Open the address that "
    "`piezod web` has printed.\n"
)
_SAFE: Final = ("GET", "HEAD")
_HEADERS: Final = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


class Access:
    """The secrets of one server: a token for people, and a cookie for their browsers.

    Args:
        cookie: Name of the cookie. Browsers send cookies to all ports of a host, hence a name for
            each.
        hosts: Further names in `Host` that are allowed.
    """

    def __init__(self, cookie: str, hosts: Container[str] = ()) -> None:
        self.token = secrets.token_urlsafe(32)
        self._cookie, self._hosts = cookie, hosts
        self._secret = secrets.token_urlsafe(32)

    def refusal(self, scope: Scope) -> str:
        """Return why a request may come from a foreign page; empty if it does not."""
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if not is_own_host(host) and host_name(host) not in self._hosts:
            return f"Host {host[:64]!r} is not this server: use localhost, or an address"
        if origin is None and scope["type"] == "websocket":
            return "a WebSocket needs an Origin"
        if origin is not None and not is_same_origin(origin, host):
            return f"Origin {origin[:64]!r} is not this server"
        return ""

    def has_cookie(self, scope: Scope) -> bool:
        """Return whether the browser has exchanged the token."""
        cookies = cookie_parser(Headers(scope=scope).get("cookie", ""))
        return _equal(cookies.get(self._cookie, ""), self._secret)

    def has_token(self, scope: Scope) -> bool:
        """Return whether the query or the header `Authorization` has the token."""
        kind, _, value = Headers(scope=scope).get("authorization", "").partition(" ")
        return _equal(_query_token(scope), self.token) or (
            kind.lower() == "bearer" and _equal(value.strip(), self.token)
        )

    def with_cookie(self) -> Response:
        """Return the answer that sets the cookie and takes the token out of the address bar."""
        answer = RedirectResponse("/", 303, {"cache-control": "no-store"})
        answer.set_cookie(self._cookie, self._secret, httponly=True, samesite="strict")
        return answer


class Door:
    """Lets requests of this server's own page in, and refuses all others.

    Args:
        app: The application behind it.
        access: The secrets.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass one request or WebSocket on, or refuse it."""
        answer = self._answer(scope)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        if answer is not None and scope["type"] == "websocket":
            await send({"type": "websocket.close"})  # before it is accepted: HTTP status 403
        else:
            await (answer or self._app)(scope, receive, send_with_headers)

    def _answer(self, scope: Scope) -> Response | None:
        """Return the answer to a request that goes no further."""
        access = self._access
        if why := access.refusal(scope):
            return PlainTextResponse(f"refused: {why}\n", 403)
        if scope["type"] == "http" and scope["method"] not in _SAFE:
            return PlainTextResponse("allowed: GET\n", 405, {"allow": ", ".join(_SAFE)})
        known, has_token = access.has_cookie(scope), access.has_token(scope)
        if scope["path"] == "/" and _query_token(scope) and (known or has_token):
            return access.with_cookie()
        if known or (has_token and scope["path"] == METRICS):
            return None
        return PlainTextResponse(_HOW, 401)


def _query_token(scope: Scope) -> str:
    query: bytes = scope["query_string"]
    return parse_qs(query.decode("latin-1")).get("token", [""])[0]


def _equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())
