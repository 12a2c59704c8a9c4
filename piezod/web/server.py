"""The process: it listens, prints its address with the token, and serves until a signal."""

import asyncio
import errno
import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from pathlib import Path
from typing import Final, NamedTuple

import uvicorn
from starlette.applications import Starlette

from piezod.config.origins import host_name
from piezod.errors import PiezodError
from piezod.web.access import Secrets, Tokens, kept_tokens
from piezod.web.app import create_app
from piezod.web.encryption import Certificate, check_certificate, require_encryption
from piezod.web.messages import LONGEST
from piezod.web.protocol import PageProtocol, TabProtocol
from piezod.web.public_url import PublicUrl
from piezod.web.stages import Stages

_MAX_HEADER: Final = 16 * 1024
_BACKLOG: Final = 128
_KEEP_ALIVE: Final = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 4),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 2),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),
)
"""A computer that has vanished is noticed within 10 s, so that its session ends."""
_EVERYWHERE: Final = ("0.0.0.0", "::")  # noqa: S104 - only with TLS


class WebPlan(NamedTuple):
    """What to serve, and where."""

    host: str = "127.0.0.1"  #: Name or address to listen on.
    port: int = 8080  #: TCP port; 0 for any free one.
    #: The certificate for TLS; None without, which is for this machine only.
    certificate: Certificate | None = None
    tokens: Path | None = None  #: Folder of lasting tokens; None for a token of this start.
    public: PublicUrl | None = None  #: Address of the page at a reverse proxy; None without one.


class WebServer(uvicorn.Server):
    """A server that leaves signals to `serve`."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture no signals."""
        yield


def serve(plan: WebPlan, announce: Callable[[str], None], warn: Callable[[str], None]) -> None:
    """Serve the page and the API until SIGINT, SIGTERM or SIGHUP.

    Args:
        plan: What to serve.
        announce: Gets the address, when it can be opened: with the token if it is of this start
            and in no file, otherwise with the name of its file.
        warn: Gets a warning about the certificate or the public address.

    Raises:
        PiezodError: If the port is in use, the host is not one of this machine, other computers
            reach it without TLS, or a file cannot be used.
        OSError: If a file cannot be read.
    """
    if plan.certificate is not None and (warning := check_certificate(plan.certificate)):
        warn(warning)
    if plan.public is not None and not plan.public.encrypted:
        warn(f"{plan.public}: whoever reads the network can move the stage; use https there")
    tokens = kept_tokens(plan.tokens) if plan.tokens else None
    with bind(plan.host, plan.port, encrypted=plan.certificate is not None) as endpoint:
        asyncio.run(_serve(endpoint, plan, tokens, announce))


def bind(host: str, port: int, *, encrypted: bool = False) -> socket.socket:
    """Return a listening socket.

    Args:
        host: Name or address to listen on.
        port: TCP port; 0 for any free one.
        encrypted: Whether TLS is used on it.

    Raises:
        PiezodError: If the port is in use, the host is not one of this machine, or other computers
            reach it without TLS.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        if not encrypted:
            require_encryption(str(address[0]), host)
        endpoint = socket.create_server(address, family=family, backlog=_BACKLOG)
    except OSError as error:
        remedy = "check the name with --host"
        if error.errno == errno.EADDRINUSE:
            remedy = "choose another port with --port, 0 for any free one"
        raise PiezodError(f"cannot listen on {host}:{port}: {error.strerror}; {remedy}") from error
    for option in _KEEP_ALIVE:
        endpoint.setsockopt(*option)  # its connections inherit them
    return endpoint


def make_server(app: Starlette, certificate: Certificate | None = None) -> WebServer:
    """Return a server; `await server.serve(sockets=[bind(host, port)])` runs it.

    Args:
        app: The application from `create_app`.
        certificate: The certificate for TLS; None without.
    """
    config = uvicorn.Config(
        app,
        http=PageProtocol,
        ws=TabProtocol,
        ws_max_size=LONGEST,
        ws_per_message_deflate=False,  # it costs more than the loopback interface does
        lifespan="off",
        loop="asyncio",
        log_config=None,
        log_level="error",  # warnings are about clients, which could fill the log
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=_MAX_HEADER,
        timeout_graceful_shutdown=5,
        ssl_certfile=certificate and certificate.file,
        ssl_keyfile=certificate and certificate.key,
    )
    return WebServer(config)


async def _serve(
    endpoint: socket.socket, plan: WebPlan, tokens: Tokens | None, announce: Callable[[str], None]
) -> None:
    port = endpoint.getsockname()[1]
    secrets = Secrets(f"piezod-{port}", {host_name(plan.host)}, tokens, plan.public)
    stages = Stages(f"web:{port}")
    server = make_server(create_app(stages, secrets), plan.certificate)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, _end, server)
    here = f"{'https' if plan.certificate else 'http'}://{_in_url(plan.host)}:{port}/"
    url = plan.public or here
    # The journal of a service has its output, and more people read it than may use the token.
    file = plan.tokens / "user" if plan.tokens else _write_token(secrets.tokens.user)
    announce(f"{url} with the token in {file}" if file else f"{url}?token={secrets.tokens.user}")
    await server.serve(sockets=[endpoint])
    await stages.jobs.aclose()
    stages.uploads.close()


def _write_token(token: str) -> Path | None:
    """Write the token to the runtime folder of the service, if this is one; return the file."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if not folder:
        return None
    file = Path(folder) / "token"
    file.unlink(missing_ok=True)
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o640), "w") as opened:
        opened.write(token)
    return file


def _end(server: WebServer) -> None:
    server.should_exit = True


def _in_url(host: str) -> str:
    if host in _EVERYWHERE:
        return socket.gethostname()
    try:
        return f"[{host}]" if ip_address(host).version == 6 else host
    except ValueError:
        return host
