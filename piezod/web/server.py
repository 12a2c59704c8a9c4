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
from typing import Final

import uvicorn
from starlette.applications import Starlette

from piezod.config.origins import host_name
from piezod.errors import PiezodError
from piezod.web.access import Access
from piezod.web.app import create_app
from piezod.web.messages import LONGEST
from piezod.web.protocol import PageProtocol, TabProtocol
from piezod.web.stages import Stages

_MAX_HEADER: Final = 16 * 1024
_BACKLOG: Final = 128


class WebServer(uvicorn.Server):
    """A server that leaves signals to `serve`."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture no signals."""
        yield


def serve(host: str, port: int, announce: Callable[[str], None]) -> None:
    """Serve the page until SIGINT, SIGTERM or SIGHUP.

    Args:
        host: Name or address to listen on.
        port: TCP port; 0 for any free one.
        announce: Gets the address of the page with the token, when it can be opened.

    Raises:
        PiezodError: If the port is in use, or the host is not one of this machine.
    """
    with bind(host, port) as endpoint:
        asyncio.run(_serve(endpoint, host, announce))


def bind(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises:
        PiezodError: If the port is in use, or the host is not one of this machine.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address, family=family, backlog=_BACKLOG)
    except OSError as error:
        remedy = "check the name with --host"
        if error.errno == errno.EADDRINUSE:
            remedy = "choose another port with --port, 0 for any free one"
        raise PiezodError(f"cannot listen on {host}:{port}: {error.strerror}; {remedy}") from error


def make_server(app: Starlette) -> WebServer:
    """Return a server; `await server.serve(sockets=[bind(host, port)])` runs it.

    Args:
        app: The application from `create_app`.
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
    )
    return WebServer(config)


async def _serve(endpoint: socket.socket, host: str, announce: Callable[[str], None]) -> None:
    port = endpoint.getsockname()[1]
    access = Access(f"piezod-{port}", {host_name(host)})
    stages = Stages(f"web:{port}")
    server = make_server(create_app(stages, access))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, _end, server)
    _write_token(access.token)
    announce(f"http://{_in_url(host)}:{port}/?token={access.token}")
    await server.serve(sockets=[endpoint])
    await stages.jobs.aclose()


def _write_token(token: str) -> None:
    """Write the token to the runtime folder of the service, if this is one."""
    if folder := os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]:
        file = Path(folder) / "token"
        file.unlink(missing_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o640), "w") as opened:
            opened.write(token)


def _end(server: WebServer) -> None:
    server.should_exit = True


def _in_url(host: str) -> str:
    try:
        return f"[{host}]" if ip_address(host).version == 6 else host
    except ValueError:
        return host
