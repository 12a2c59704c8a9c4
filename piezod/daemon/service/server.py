"""The service on its unix socket."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

import uvicorn
from fastapi import FastAPI

from piezod.daemon.service.peer_protocol import ConnectionLimits, PeerProtocol

if TYPE_CHECKING:
    import asyncio

_MAX_HEADER: Final = 64 * 1024
_NOT_OTHERS: Final = 0o117  # the socket is for its user and its group; the folder decides which


class ApiServer(uvicorn.Server):
    """A server that leaves the signals to the supervisor: it ends when `should_exit` is set."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield


def make_server(app: FastAPI, limits: ConnectionLimits) -> ApiServer:
    """Make a server; `await server.serve(sockets=[bind(path)])` runs it.

    Args:
        app: What `create_app` makes.
        limits: What a connection may do.
    """
    protocol = partial(PeerProtocol, limits=limits)
    config = uvicorn.Config(
        app,
        # uvicorn calls it, and asks nothing else of it.
        http=cast("type[asyncio.Protocol]", protocol),
        ws="none",
        lifespan="off",
        loop="asyncio",
        log_config=None,
        log_level="error",  # its warnings are about clients, who could fill a log with them
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=_MAX_HEADER,
        timeout_keep_alive=limits.idle_s,
        timeout_graceful_shutdown=5,
    )
    return ApiServer(config)


def bind(path: Path) -> socket.socket:
    """Bind the socket, readable and writable for its user and group; one left behind is replaced.

    Call it only with the daemon's lock held: what is at the path belongs to nobody then.

    Raises:
        OSError: If it cannot be bound.
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
