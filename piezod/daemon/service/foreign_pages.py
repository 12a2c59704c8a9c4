"""Refuses requests that a web page of a foreign site makes a browser send.

A browser cannot reach the socket, unless somebody forwards it to a TCP port, as with `ssh -L`. Then
any page could arm the stage: a POST without a body is a simple request, which a browser sends
across origins without asking the server. Other programs than browsers are not restricted.
"""

from typing import Final

from starlette.datastructures import Headers
from starlette.types import Scope

from piezod.config.origins import is_own_host, is_same_origin
from piezod.daemon.service.refusals import ForeignPageError

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
