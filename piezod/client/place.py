"""Where a client reaches a daemon: a socket of this machine, or `piezod web` of another one."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import SplitResult, urlsplit

from piezod.client.places import check_socket, find_socket, is_address
from piezod.config.private_files import checked_token, read_token
from piezod.errors import ClientError, NotRunningError, PiezodError

if TYPE_CHECKING:
    import ssl

_LOCAL: Final = "http://piezod"
"""On a unix socket the host name has no meaning."""
_FORM: Final = "an address is like https://labpc:8080/stages/bench"


@dataclass(frozen=True)
class Place:
    """The place of a daemon."""

    socket: Path | None = None  #: Its socket; None on another machine.
    url: str = _LOCAL  #: Address of the stage at `piezod web`, without the final `/v1/…`.
    token: str = field(default="", repr=False)  #: Token for that address; empty on a socket.
    #: File with the only certificates to trust; None for those of this system.
    ca: Path | None = None

    def __str__(self) -> str:
        """Return the socket or the address, for people."""
        return str(self.socket or self.url)

    @property
    def stage(self) -> str:
        """Name of the stage as far as the place tells it."""
        if self.socket is not None:
            return self.socket.parent.name
        parts = urlsplit(self.url)
        return parts.path.rpartition("/")[2] or str(parts.hostname)

    @property
    def headers(self) -> list[tuple[bytes | str, bytes | str]]:
        """Headers that each request needs."""
        return [("Authorization", f"Bearer {self.token}")] if self.token else []

    def ended(self) -> NotRunningError:
        """Return the error of a daemon that has ended since the client connected."""
        if self.socket is None:
            return NotRunningError(f"{self}: the connection has ended", _LOOK_THERE)
        return NotRunningError(f"{self}: the daemon has ended", "check that it still runs")

    def unreachable(self, cause: BaseException | None) -> ClientError:
        """Return the error of a connection that could not be opened."""
        if self.socket is not None:
            return self.ended()
        while cause is not None:
            if text := getattr(cause, "verify_message", ""):  # an error of ssl
                what = f"{self}: the certificate is not trusted: {text}"
                remedy = "name its file in PIEZOD_CA, and use a name of it in the address"
                return ClientError(what, remedy, "certificate")
            cause = cause.__cause__ or cause.__context__
        return NotRunningError(f"{self}: no answer", _LOOK_THERE)

    def trusted(self) -> "ssl.SSLContext | None":
        """Return what a connection must prove; None without TLS.

        Raises:
            ClientError: If the file of the certificates cannot be read.
        """
        if not self.url.startswith("https"):
            return None
        import ssl

        try:
            return ssl.create_default_context(cafile=self.ca)
        except OSError as error:
            what = f"{self.ca}: no certificate can be read ({error.strerror})"
            raise ClientError(what, "name the file of the server's certificate in PIEZOD_CA") from (
                error
            )


_LOOK_THERE: Final = "check the address, and that `piezod web` and the stage run there"


def find_place(
    stage: str | None, socket: Path | None, environ: Mapping[str, str] = os.environ
) -> Place:
    """Return the place of the chosen stage.

    Args:
        stage: Name of a stage of this machine, or an address; None for `PIEZOD_STAGE`, or the only
            stage that runs.
        socket: Path of a socket, in place of a name.
        environ: Environment variables: those of `find_socket`; for an address also
            `PIEZOD_TOKEN_FILE` or `PIEZOD_TOKEN`, and `PIEZOD_CA`.

    Raises:
        ClientError: If there is no daemon, or the address, the token or the certificate cannot be
            used.
    """
    if socket is None and is_address(name := stage or _of_environment(environ)):
        return _remote(name, environ)
    return Place(check_socket(socket or find_socket(stage, environ)))


def _of_environment(environ: Mapping[str, str]) -> str:
    return "" if environ.get("PIEZOD_SOCKET") else environ.get("PIEZOD_STAGE", "")


def _remote(url: str, environ: Mapping[str, str]) -> Place:
    parts = urlsplit(url)
    if parts.username or parts.password or parts.query or parts.fragment:
        # Others see the arguments of a program.
        what = "an address with a token, a user or a query is refused, and so is what it contains"
        raise ClientError(what, "put the token into a file, and name it in PIEZOD_TOKEN_FILE")
    if not parts.hostname:
        raise ClientError(f"{url}: this address has no host", _FORM)
    if parts.scheme == "http" and not _is_here(parts):
        what = f"{url}: an address of another machine without TLS is refused"
        raise ClientError(what, "use https, or forward the port with `ssh -L`")
    ca = environ.get("PIEZOD_CA")
    return Place(None, url.rstrip("/"), _token(environ), Path(ca) if ca else None)


def _is_here(parts: SplitResult) -> bool:
    if parts.hostname == "localhost":
        return True
    try:
        return ip_address(str(parts.hostname)).is_loopback
    except ValueError:
        return False


def _token(environ: Mapping[str, str]) -> str:
    try:
        if file := environ.get("PIEZOD_TOKEN_FILE"):
            return read_token(Path(file))
        if token := environ.get("PIEZOD_TOKEN"):
            return checked_token(token.strip(), "PIEZOD_TOKEN")
    except OSError as error:
        raise ClientError(f"{error.filename}: {error.strerror}", _NAME_TOKEN) from error
    except PiezodError as error:
        raise ClientError(str(error)) from error
    raise ClientError("a stage on another machine needs a token", _NAME_TOKEN)


_NAME_TOKEN: Final = "name the file of the token in PIEZOD_TOKEN_FILE"  # noqa: S105 - a text
