"""The address of the page at a reverse proxy, which has a name and a path of its own."""

from ipaddress import ip_address
from typing import Final, NamedTuple, Self
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from piezod.config.origins import host_name
from piezod.errors import PiezodError

_FORM: Final = "the public address is like https://lab.example/piezod/"
_PORTS: Final = {"http": 80, "https": 443}


class PublicUrl(NamedTuple):
    """Address at which browsers and programs reach the proxy."""

    origin: str  #: Scheme, name and port, as browsers send it in `Origin`.
    path: str  #: Its path, with a "/" at the end.

    @classmethod
    def of(cls, text: str) -> Self:
        """Return the parts of an address.

        Raises:
            PiezodError: If it is no address of a page.
        """
        try:
            parts = urlsplit(text)
            port = parts.port
        except ValueError as error:
            raise PiezodError(f"{text}: {error}; {_FORM}") from error
        if parts.scheme not in _PORTS or not parts.hostname:
            raise PiezodError(f"{text}: this address has no http, https or no host; {_FORM}")
        if parts.username or parts.query or parts.fragment:
            raise PiezodError(f"{text}: user, query and fragment are refused; {_FORM}")
        name = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        # Browsers leave out the port that the scheme has anyway.
        end = "" if port in (None, _PORTS[parts.scheme]) else f":{port}"
        return cls(f"{parts.scheme}://{name}{end}", f"{parts.path.rstrip('/')}/")

    def __str__(self) -> str:
        """Return the address of the page."""
        return f"{self.origin}{self.path}"

    @property
    def name(self) -> str:
        """Name or address of the proxy, as in `Host`, without the port."""
        return host_name(self.origin.partition("://")[2])

    @property
    def encrypted(self) -> bool:
        """Whether TLS leads to the proxy."""
        return self.origin.startswith("https:")

    def arrived(self, scope: Scope) -> Scope:
        """Return a request as if there were no proxy: without its path, from its client."""
        path, last = scope["path"], Headers(scope=scope).get("x-forwarded-for", "").split(",")[-1]
        if path.startswith(self.path):  # a proxy may also have taken it away
            scope = {**scope, "path": path[len(self.path) - 1 :]}
        try:
            client = ip_address(last.strip())
        except ValueError:
            return scope
        return {**scope, "client": (str(client), 0)}
