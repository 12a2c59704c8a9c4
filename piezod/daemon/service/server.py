"""The service on its unix socket."""

import asyncio
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final, cast

import uvicorn
from fastapi import FastAPI

from piezod.daemon.service.peer_protocol import ConnectionLimits, PeerProtocol

_MAX_HEADER: Final = 64 * 1024
_BACKLOG: Final = 128
"""Connections that wait to be accepted; asyncio accepts so many at once, and without descriptors it
fails as many times."""
_NOT_OTHERS: Final = 0o117  # user and group may use the socket; its folder sets the group


class ApiServer(uvicorn.Server):
    """A server that leaves signals to the supervisor, and ends when `should_exit` is set."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture no signals."""
        yield

    async def listen(self, endpoint: socket.socket) -> None:
        """Accept connections on a further socket, from `bind`, as on those of `serve`."""

        def protocol() -> "asyncio.Protocol":
            state = self.server_state, self.lifespan.state
            make = cast("Callable[..., asyncio.Protocol]", self.config.http_protocol_class)
            return make(config=self.config, server_state=state[0], app_state=state[1])

        loop = asyncio.get_running_loop()
        self.servers.append(
            await loop.create_unix_server(protocol, sock=endpoint, backlog=self.config.backlog)
        )


def make_server(app: FastAPI, limits: ConnectionLimits) -> ApiServer:
    """Return a server; `await server.serve(sockets=[bind(path)])` runs it.

    Args:
        app: The application from `create_app`.
        limits: Limits of each connection.
    """
    protocol = partial(PeerProtocol, limits=limits)
    config = uvicorn.Config(
        app,
        # uvicorn only calls it, so a partial will do.
        http=cast("type[asyncio.Protocol]", protocol),
        ws="none",
        lifespan="off",
        loop="asyncio",
        log_config=None,
        log_level="error",  # warnings are about clients, which could fill the log
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=_MAX_HEADER,
        backlog=_BACKLOG,
        timeout_keep_alive=limits.idle_s,
        timeout_graceful_shutdown=5,
    )
    return ApiServer(config)


def bind(path: Path) -> socket.socket:
    """Bind the socket for its user and group; replace a socket that a dead daemon left.

    Call it only while holding the lock of the daemon: no other daemon uses the path then.

    Raises:
        OSError: If the path cannot be bound.
    """
    path.unlink(missing_ok=True)
    endpoint = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(_NOT_OTHERS)
    try:
        endpoint.bind(str(path))
    except OSError:
        endpoint.close()
        raise
    finally:
        os.umask(before)
    return endpoint
