"""The process: it listens on TCP and on a pty, and serves until a signal."""

import asyncio
import errno
import signal
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from contextlib import ExitStack, suppress
from ipaddress import IPv4Address
from itertools import count
from pathlib import Path
from typing import Any, Final, NamedTuple

import piezod
from piezod.client import request_bodies  # noqa: F401 - slow; no command shall wait for it later
from piezod.client.daemon_link import DaemonLink
from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.devices.emulation.pty_end import PtyEnd
from piezod.errors import PiezodError
from piezod.gcs.readings import Readings
from piezod.gcs.session import GcsSession
from piezod.messages.answers import Status

MOST_CLIENTS: Final = 8
"""A daemon serves 16 connections of one user, who may have other programs."""
_MOST_BYTES: Final = 4096
_WAIT_NS: Final = 100_000_000
_LOOPBACK: Final = "127.0.0.1"
_EVERYWHERE: Final = "0.0.0.0"  # noqa: S104 - only if addresses are named, and only for them


class GcsPlan(NamedTuple):
    """What to serve, and where."""

    socket: Path  #: Socket of the daemon.
    mode: str  #: The mode that `SVO 1` selects.
    port: int  #: TCP port; 0 for any free one.
    allowed: Sequence[IPv4Address] = ()  #: Addresses of other computers that may connect.
    pty: Path | None = None  #: Path of a serial port to make; None for none.
    like: str = ""  #: Model of a controller to name in the identity, for clients that look for one.


def serve(plan: GcsPlan, announce: Callable[[str], None], report: Callable[[str], None]) -> None:
    """Serve a stage until SIGINT or SIGTERM.

    Args:
        plan: What to serve.
        announce: Gets the places, when they can be opened.
        report: Gets the text of each refusal.

    Raises:
        PiezodError: If the daemon does not run, or a place is in use.
    """
    asyncio.run(GcsServer(plan, report).serve(announce))


def identity_of(status: Status, like: str) -> str:
    """Return the reply to `*IDN?`: maker, model, serial number and version."""
    model = f"piezod {status.stage}".strip() + (f" like {like}" if like else "")
    return f"(c)2026 piezod, {model.replace(',', ' ')}, 0, {piezod.__version__}"


def refusal(plan: GcsPlan, address: IPv4Address, clients: int) -> str:
    """Return why a client may not connect; empty if it may."""
    if not address.is_loopback and address not in plan.allowed:
        return f"{address} is not allowed: name it with --allow"
    if clients >= MOST_CLIENTS:
        return f"{clients} clients are connected, allowed: {MOST_CLIENTS}"
    return ""


class GcsServer:
    """Serves one stage to several clients.

    Args:
        plan: What to serve.
        report: Gets the text of each refusal.
    """

    def __init__(self, plan: GcsPlan, report: Callable[[str], None]) -> None:
        self._plan, self._report = plan, report
        self._clients: set[asyncio.Task[None]] = set()
        self._numbers = count(1)
        self._identity, self._port = "", plan.port

    async def serve(self, announce: Callable[[str], None]) -> None:
        """Serve until a signal; then close all connections.

        Raises:
            PiezodError: If the daemon does not run, or a place is in use.
        """
        ended = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, ended.set)
        link = DaemonLink(self._plan.socket, "gcs")
        self._readings = Readings(StageMirror(link), self._plan.mode)
        try:
            status = await self._readings.mirror.status()
            self._identity = identity_of(status, self._plan.like)
            with ExitStack() as stack:
                server = await self._listen()
                async with server:
                    places = [f"{_LOOPBACK}:{self._port}", *self._open_pty(stack)]
                    axes = ", ".join(f"{i} {name}" for i, name in enumerate(status.axes, 1))
                    announce(f"GCS 2 at {' and '.join(places)}: stage {status.stage}, axes {axes}")
                    await ended.wait()
                    await self._end_clients()
        finally:
            await link.close()

    async def _listen(self) -> asyncio.Server:
        host, port = _EVERYWHERE if self._plan.allowed else _LOOPBACK, self._plan.port
        try:
            server = await asyncio.start_server(self._welcome, host, port)
        except OSError as error:
            remedy = ""
            if error.errno == errno.EADDRINUSE:
                remedy = "; choose another port with --port, 0 for any free one"
            raise PiezodError(
                f"cannot listen on {host}:{port}: {error.strerror}{remedy}"
            ) from error
        self._port = server.sockets[0].getsockname()[1]
        return server

    def _open_pty(self, stack: ExitStack) -> list[str]:
        if self._plan.pty is None:
            return []
        end = PtyEnd(self._plan.pty)
        end.appear()
        stack.callback(end.vanish)
        self._start(self._serve_pty(end))
        return [end.place()]

    def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a client, unless it may not connect or there are too many."""
        address = IPv4Address(writer.get_extra_info("peername")[0])
        why = refusal(self._plan, address, len(self._clients))
        if why:
            self._report(f"refused a connection: {why}")
            writer.transport.abort()
            return
        self._start(self._serve_tcp(reader, writer))

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._clients.add(task)
        task.add_done_callback(self._clients.discard)

    async def _serve_tcp(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async def send(reply: bytes) -> None:
            writer.write(reply)
            await writer.drain()

        try:
            await self._serve(lambda: reader.read(_MOST_BYTES), send)
        except OSError as error:
            self._report(f"closed a connection: {error}")
        finally:
            writer.close()

    async def _serve_pty(self, end: PtyEnd) -> None:
        async def receive() -> bytes:
            # In a thread: a pty without a client is no file that an event loop can watch.
            while not (data := await asyncio.to_thread(end.receive, _WAIT_NS)):
                pass
            return data

        async def send(reply: bytes) -> None:
            end.send(reply)

        await self._serve(receive, send)

    async def _serve(
        self,
        receive: Callable[[], Awaitable[bytes]],
        send: Callable[[bytes], Awaitable[None]],
    ) -> None:
        """Serve a client until it leaves; commands that wait then are dropped."""
        name = f"gcs:{self._port}:{next(self._numbers)}"
        session = GcsSession(
            StageMover(DaemonLink(self._plan.socket, name)),
            self._readings,
            self._plan.mode,
            self._identity,
            lambda text: self._report(f"{name}: {text}"),
            send,
        )

        async def read() -> None:
            while data := await receive():
                session.take(data)

        tasks = asyncio.create_task(read()), asyncio.create_task(session.work())
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            ended = await asyncio.gather(*tasks, return_exceptions=True)
            await session.close()
        for each in ended:
            if isinstance(each, Exception):
                raise each

    async def _end_clients(self) -> None:
        for task in tuple(self._clients):
            task.cancel()
        with suppress(asyncio.CancelledError):
            await asyncio.gather(*self._clients, return_exceptions=True)
