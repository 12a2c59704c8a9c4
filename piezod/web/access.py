"""Who may use the server: the checks of every request and every WebSocket, before anything else."""

import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from piezod.config.origins import host_name, is_own_host, is_same_origin
from piezod.config.private_files import kept_token
from piezod.messages.endpoints import Role
from piezod.own_folder import make_folder
from piezod.web.public_url import PublicUrl

UPLOADS: Final = "/uploads/"
"""Where a page sends files, each to the name of a stage."""
METRICS: Final = "/metrics"
API: Final = ("/v1/", "/stages/")
"""Begin of the paths that lead to daemons; they take a token in the header, and no cookie."""
_ROLE: Final = "piezod.role"
_HOW: Final = (
    "refused: the token is missing, or is not that of this start. Open the address that "
    "`piezod web` has printed.\n"
)
_NO_TOKEN: Final = {
    "code": "unauthorised",
    "what": "the header `Authorization: Bearer TOKEN` is missing, or has another token",
    "remedy": "send a token of this server; docs/remote.md tells where it is",
}
_SAFE: Final = ("GET", "HEAD")
_SECURE: Final = ("https", "wss")
_HEADERS: Final = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


class Tokens(NamedTuple):
    """The tokens of one server."""

    user: str  #: For everything that the user of this server may do.
    viewer: str  #: For what a viewer may do.


def new_tokens() -> Tokens:
    """Return tokens for one start."""
    return Tokens(secrets.token_urlsafe(32), secrets.token_urlsafe(32))


def kept_tokens(folder: Path) -> Tokens:
    """Return the tokens of a folder; make those that are missing.

    Raises:
        PiezodError: If other users can read a token, or a file has none.
        OSError: If a file can be neither read nor made.
    """
    make_folder(folder)
    return Tokens(*(kept_token(folder / name) for name in Tokens._fields))


class Secrets:
    """The secrets of one server: tokens for people and programs, and cookies for browsers.

    Args:
        cookie: Name of the cookie. Browsers send cookies to all ports of a host, hence a name for
            each.
        hosts: Further names in `Host` that are allowed.
        tokens: The tokens; new ones if not given.
        public: Address of the page at a reverse proxy; None without one.
    """

    def __init__(
        self,
        cookie: str,
        hosts: Iterable[str] = (),
        tokens: Tokens | None = None,
        public: PublicUrl | None = None,
    ) -> None:
        self.public = public
        self.tokens = tokens or new_tokens()
        self._cookie, self._hosts = cookie, {*hosts, *([public.name] if public else [])}
        self._cookies = {secrets.token_urlsafe(32): role for role in _ROLES}
        self._tokens = dict(zip(self.tokens, _ROLES, strict=True))

    def refusal(self, scope: Scope) -> str:
        """Return why a request may come from a foreign page; empty if it does not."""
        headers, encrypted = Headers(scope=scope), scope["scheme"] in _SECURE
        host, origin = headers.get("host", ""), headers.get("origin")
        # With TLS no foreign name leads here: the certificate does not have it.
        if not encrypted and not is_own_host(host) and host_name(host) not in self._hosts:
            return (
                f"Host {host[:64]!r} is not this server: use localhost, or an address; behind a "
                "proxy start `piezod web` with its address as --public-url"
            )
        if origin is None and (scope["type"] == "websocket" or is_upload(scope)):
            return "a WebSocket or a file needs an Origin"
        if self.public is not None and origin == self.public.origin:
            return ""  # a proxy may send another `Host` than the browser
        if origin is not None and not _is_own(origin, host, secure=self.is_secure(scope)):
            return f"Origin {origin[:64]!r} is not this server"
        return ""

    def is_secure(self, scope: Scope) -> bool:
        """Return whether the client uses TLS, up to this server or to the proxy."""
        name = host_name(Headers(scope=scope).get("host", ""))
        by_proxy = self.public is not None and self.public.encrypted and self.public.name == name
        return by_proxy or scope["scheme"] in _SECURE

    def cookie_role(self, scope: Scope) -> Role | None:
        """Return the role of the token that the browser has exchanged; None if it has not."""
        cookies = cookie_parser(Headers(scope=scope).get("cookie", ""))
        return _found(cookies.get(self._cookie, ""), self._cookies)

    def query_role(self, scope: Scope) -> Role | None:
        """Return the role of the token in the query; None without one."""
        return _found(_query_token(scope), self._tokens)

    def header_role(self, scope: Scope) -> Role | None:
        """Return the role of the token in the header `Authorization`; None without one."""
        kind, _, value = Headers(scope=scope).get("authorization", "").partition(" ")
        return _found(value.strip(), self._tokens) if kind.lower() == "bearer" else None

    def with_cookie(self, role: Role, *, secure: bool) -> Response:
        """Return the answer that sets the cookie and takes the token out of the address bar."""
        answer = RedirectResponse("./", 303, {"cache-control": "no-store"})
        value = next(each for each, its_role in self._cookies.items() if its_role == role)
        answer.set_cookie(
            self._cookie, value, path=None, httponly=True, samesite="strict", secure=secure
        )  # without a path it belongs to that of the page, which a proxy may have changed
        return answer


class Door:
    """Lets requests with a secret in, and refuses all others.

    Args:
        app: The application behind it.
        secrets: The secrets.
    """

    def __init__(self, app: ASGIApp, secrets: Secrets) -> None:
        self._app, self._secrets = app, secrets

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass one request or WebSocket on, or refuse it."""
        if self._secrets.public is not None:
            scope = self._secrets.public.arrived(scope)
        answer = self._answer(scope)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        if answer is not None and scope["type"] == "websocket":
            await send({"type": "websocket.close"})  # before it is accepted: HTTP status 403
        elif scope["path"].startswith(API):  # for programs: what browsers need would only be long
            await (answer or self._app)(scope, receive, send)
        else:
            await (answer or self._app)(scope, receive, send_with_headers)

    def _answer(self, scope: Scope) -> Response | None:
        """Return the answer to a request that goes no further; note the role of others."""
        secrets, path = self._secrets, scope["path"]
        if why := secrets.refusal(scope):
            return PlainTextResponse(f"refused: {why}\n", 403)
        if scope["type"] == "http" and path.startswith(API):
            scope[_ROLE] = secrets.header_role(scope)
            challenge = {"www-authenticate": "Bearer"}
            return JSONResponse({"error": _NO_TOKEN}, 401, challenge) if not scope[_ROLE] else None
        if scope["type"] == "http" and scope["method"] not in _SAFE and not is_upload(scope):
            return PlainTextResponse("allowed: GET\n", 405, {"allow": ", ".join(_SAFE)})
        by_query, by_cookie = secrets.query_role(scope), secrets.cookie_role(scope)
        if path == "/" and _query_token(scope) and (role := by_query or by_cookie):
            return secrets.with_cookie(role, secure=secrets.is_secure(scope))
        scope[_ROLE] = by_cookie
        if by_cookie or (path == METRICS and (by_query or secrets.header_role(scope))):
            return None
        return PlainTextResponse(_HOW, 401)


def is_upload(scope: Scope) -> bool:
    """Return whether a request sends a file."""
    path: str = scope["path"]
    return scope["type"] == "http" and scope["method"] == "POST" and path.startswith(UPLOADS)


def role_of(scope: Scope) -> Role:
    """Return the largest role that an admitted request or WebSocket may use."""
    role: Role = scope[_ROLE]
    return role


_ROLES: Final = (Role.ENGINEER, Role.VIEWER)
"""Roles of the tokens, in their order. The daemon limits the first one to that of the user."""


def _query_token(scope: Scope) -> str:
    query: bytes = scope["query_string"]
    return parse_qs(query.decode("latin-1")).get("token", [""])[0]


def _is_own(origin: str, host: str, *, secure: bool) -> bool:
    # A page without TLS can be forged on its way; it may not use the server with TLS.
    return is_same_origin(origin, host) and not (secure and origin.lower().startswith("http:"))


def _found(given: str, known: Mapping[str, Role]) -> Role | None:
    equal = [secrets.compare_digest(given.encode(), each.encode()) for each in known]
    return next((role for role, same in zip(known.values(), equal, strict=True) if same), None)
