"""Connections that belong to the process which opened them, whatever its forked children do.

A child of `multiprocessing` inherits the open sockets. If it used one, both processes would read
the answers of each other. If it only kept one, the socket would stay open after the end of its
parent, and the session with it. Hence a forked child lets go of the sockets, a connection refuses
another process, and its end is told to the daemon by `shutdown`, which acts on all copies.
"""

import os
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, Generic, TypeVar
from weakref import WeakSet

import httpcore

from piezod.errors import ClientError

PoolT = TypeVar("PoolT")


class PoolOfProcess(Generic[PoolT]):
    """The pool of connections of a client; a forked child gets a new one at its first call.

    Args:
        make: Returns a pool without connections.
    """

    def __init__(self, make: Callable[[], PoolT]) -> None:
        self._make, self._closed = make, False
        self._pid, self._pool = os.getpid(), make()

    def get(self) -> PoolT:
        """Return the pool of this process.

        Raises:
            RuntimeError: If the client is closed.
        """
        if self._closed:
            raise RuntimeError("this client is closed: make another one")
        if self._pid != os.getpid():
            self._pid, self._pool = os.getpid(), self._make()
        return self._pool

    def close(self) -> PoolT:
        """Refuse further calls; return the pool, whose connections the caller closes."""
        pool = self._pool if self._closed else self.get()
        self._closed = True
        return pool


class _Owned:
    """What streams for threads and for asyncio share."""

    def __init__(self, stream: Any) -> None:
        self._stream, self._pid = stream, os.getpid()
        _OPEN.add(self)

    def get_extra_info(self, info: str) -> Any:
        """Return a property of the stream, such as its socket."""
        return self._stream.get_extra_info(info)

    def _check(self) -> None:
        if self._pid != os.getpid():
            raise ClientError(
                f"process {self._pid} began this, and process {os.getpid()}, which was forked from "
                "it, cannot go on with it",
                "begin it in the process that uses it; single calls work in both",
                "forked",
            )

    def _shut_down(self) -> bool:
        """Tell the other end that this is the end; return False in another process."""
        if self._pid != os.getpid():
            return False
        with suppress(OSError):  # the other end was faster
            self.get_extra_info("socket").shutdown(socket.SHUT_RDWR)
        return True


_OPEN: "Final[WeakSet[_Owned]]" = WeakSet()


def _let_go() -> None:
    """Put nothing in the place of each inherited socket; the number stays that of the socket."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in list(_OPEN):
        with suppress(OSError):
            number = stream.get_extra_info("socket").fileno()
            if number >= 0:  # it is not closed
                os.dup2(nothing, number, inheritable=False)
    os.close(nothing)


os.register_at_fork(after_in_child=_let_go)


class _Stream(_Owned, httpcore.NetworkStream):
    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        self._check()
        received: bytes = self._stream.read(max_bytes, timeout)
        return received

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        self._check()
        self._stream.write(buffer, timeout)

    def close(self) -> None:
        if self._shut_down():
            self._stream.close()

    def start_tls(
        self,
        ssl_context: ssl.SSLContext,
        server_hostname: str | None = None,
        timeout: float | None = None,
    ) -> httpcore.NetworkStream:
        return _Stream(self._stream.start_tls(ssl_context, server_hostname, timeout))


class Backend(httpcore.SyncBackend):
    """Opens connections of a process, for a pool of httpcore."""

    def connect_tcp(self, *args: Any, **options: Any) -> httpcore.NetworkStream:
        """Return a connection to a port."""
        return _Stream(super().connect_tcp(*args, **options))

    def connect_unix_socket(self, *args: Any, **options: Any) -> httpcore.NetworkStream:
        """Return a connection to a socket of this machine."""
        return _Stream(super().connect_unix_socket(*args, **options))


class _AsyncStream(_Owned, httpcore.AsyncNetworkStream):
    async def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        self._check()
        received: bytes = await self._stream.read(max_bytes, timeout)
        return received

    async def write(self, buffer: bytes, timeout: float | None = None) -> None:
        self._check()
        await self._stream.write(buffer, timeout)

    async def aclose(self) -> None:
        if self._shut_down():
            await self._stream.aclose()

    async def start_tls(
        self,
        ssl_context: ssl.SSLContext,
        server_hostname: str | None = None,
        timeout: float | None = None,
    ) -> httpcore.AsyncNetworkStream:
        return _AsyncStream(await self._stream.start_tls(ssl_context, server_hostname, timeout))


class AsyncBackend(httpcore.AnyIOBackend):
    """The same for asyncio."""

    async def connect_tcp(self, *args: Any, **options: Any) -> httpcore.AsyncNetworkStream:
        """Return a connection to a port."""
        return _AsyncStream(await super().connect_tcp(*args, **options))

    async def connect_unix_socket(self, *args: Any, **options: Any) -> httpcore.AsyncNetworkStream:
        """Return a connection to a socket of this machine."""
        return _AsyncStream(await super().connect_unix_socket(*args, **options))
