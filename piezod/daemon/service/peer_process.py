"""The process at the other end of a connection: a session ends with it."""

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager

from piezod.daemon.service.peer_protocol import PeerProtocol


@contextmanager
def closed_with_its_process(connection: PeerProtocol) -> Iterator[None]:
    """Close a connection when the process that opened it ends.

    The kernel alone closes it later, if a child of that process has inherited the socket.

    Args:
        connection: Connection to a unix socket. Where the kernel gives no handle of its process,
            as for one of another container, nothing is watched.
    """
    try:
        handle = os.pidfd_open(connection.credentials.pid)
    except ProcessLookupError:  # it has ended already
        connection.abort()
        yield
        return
    except OSError:
        yield
        return
    loop = asyncio.get_running_loop()
    loop.add_reader(handle, connection.abort)
    try:
        yield
    finally:
        loop.remove_reader(handle)
        os.close(handle)
