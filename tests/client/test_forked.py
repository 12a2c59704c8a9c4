"""A program that has forked: `multiprocessing` and the sockets that its children inherit."""

import asyncio
import json
import multiprocessing
import os
import signal
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.client import AsyncStageClient, StageClient, StageGroup
from piezod.config import requests
from piezod.daemon.service.peer_protocol import ConnectionLimits
from piezod.errors import ClientError
from piezod.telemetry.arrays import record_dtype
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually
from tests.web.browser import Web
from tests.web.remote import Remote, new_certificate

FORK = multiprocessing.get_context("fork")
WITHIN_S = 20.0
Process = multiprocessing.context.ForkProcess


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """Return a service whose stage accepts everything."""
    served = Served(tmp_path, ConnectionLimits())
    with served.running():
        yield served


def sleeper() -> Process:
    """Start a child that does nothing, as a worker of `multiprocessing` between two tasks."""
    child = FORK.Process(target=time.sleep, args=(1000.0,), daemon=True)
    child.start()
    return child


@contextmanager
def started(run: Callable[[Any, Connection], None], place: Any) -> Iterator[tuple[Process, int]]:
    """Run a program in a process that forks once; yield it and its child's number.

    The child lives until the end of the block.
    """
    mine, its = FORK.Pipe()
    process = FORK.Process(target=run, args=(place, its))
    process.start()
    child = 0
    try:
        assert mine.poll(WITHIN_S), "the program has not forked"
        child = mine.recv()
        yield process, child
    finally:
        process.kill()
        process.join()
        if child:
            os.kill(child, signal.SIGKILL)


def own(place: Path, its: Connection) -> None:
    """Own a session, fork, and wait for the end; the child inherits the socket."""
    with StageClient(socket=place, name="owner") as stage, stage.session():
        its.send(sleeper().pid)
        time.sleep(1000.0)


def own_in_group(place: Path, its: Connection) -> None:
    """Own a session of a group."""
    with StageGroup(["bench"], name="owner") as group:
        group._clients["bench"] = StageClient(socket=place, name="owner")  # noqa: SLF001 - no name
        with group.session():
            its.send(sleeper().pid)
            time.sleep(1000.0)


def own_async(place: Path, its: Connection) -> None:
    """Own a session with the client for asyncio."""

    async def run() -> None:
        async with AsyncStageClient(socket=place, name="owner") as stage, stage.session():
            its.send(sleeper().pid)
            await asyncio.sleep(1000.0)

    asyncio.run(run())


def own_by_hand(place: Path, its: Connection) -> None:
    """Own a session as a program in another language may do; nothing lets go in its child."""
    body = b"POST /v1/session HTTP/1.1\r\nHost: piezod\r\nX-Piezod-Client: owner\r\n"
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(place))
        connection.sendall(body + b"Content-Type: application/json\r\nContent-Length: 2\r\n\r\n{}")
        connection.recv(1000)
        its.send(sleeper().pid)
        time.sleep(1000.0)


def free(served: Served) -> bool:
    """Return whether the session has ended: the stage is stopped, and nobody has the lease."""
    return requests.Stop() in served.stage.requests and not served.app.state.service.lease.held


@pytest.mark.fault("C15")
@pytest.mark.parametrize("run", [own, own_in_group, own_async, own_by_hand])
def test_session_ends_with_its_owner_although_a_child_lives(
    served: Served, run: Callable[[Any, Connection], None]
) -> None:
    """`kill -9` of the owner stops the stage and frees the lease; its child has the socket too."""
    with started(run, served.socket) as (owner, child):
        eventually(lambda: served.app.state.service.lease.held)
        assert not free(served)
        owner.kill()
        owner.join()
        eventually(lambda: free(served))
        os.kill(child, 0)  # it lives


def leave(place: Path, its: Connection) -> None:
    """Leave a session in order, and live on with the child."""
    with StageClient(socket=place, name="owner") as stage:
        with stage.session():
            child = sleeper()
        its.send(child.pid)
        time.sleep(1000.0)


def leave_async(place: Path, its: Connection) -> None:
    """Leave a session in order with the client for asyncio."""

    async def run() -> None:
        async with AsyncStageClient(socket=place, name="owner") as stage:
            async with stage.session():
                child = sleeper()
            its.send(child.pid)
            await asyncio.sleep(1000.0)

    asyncio.run(run())


@pytest.mark.parametrize("run", [leave, leave_async])
def test_session_ends_with_its_block_although_a_child_lives(
    served: Served, run: Callable[[Any, Connection], None]
) -> None:
    """Leaving the block is enough."""
    with started(run, served.socket):
        eventually(lambda: free(served))


def test_session_over_the_network_ends_with_its_owner(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No daemon sees the process on another computer, but its child has let go of the socket."""
    web = Web(lambda: {"bench": served.socket}, new_certificate(tmp_path))
    with web.running():
        environ = Remote(web, tmp_path).environ()
        for name, value in environ.items():
            monkeypatch.setenv(name, value)
        with started(own_there, environ["PIEZOD_STAGE"]) as (owner, _):
            eventually(lambda: served.app.state.service.lease.held)
            owner.kill()
            owner.join()
            eventually(lambda: free(served))


def own_there(place: str, its: Connection) -> None:
    """Own a session of a stage on another computer."""
    with StageClient(place, name="owner") as stage, stage.session():
        its.send(sleeper().pid)
        time.sleep(1000.0)


def told(child: Callable[[], Any]) -> Any:
    """Fork; return what the child returns, or the text of its error."""
    mine, its = FORK.Pipe()

    def run() -> None:
        try:
            its.send(child())
        except Exception as error:  # noqa: BLE001 - the parent judges it
            its.send(f"{type(error).__name__}: {error}")

    process = FORK.Process(target=run)
    process.start()
    answer = mine.recv() if mine.poll(WITHIN_S) else "no answer"
    process.join(WITHIN_S)
    return answer


def test_parent_and_child_get_their_own_answers(served: Served) -> None:
    """Both use one client at the same time: the child has a connection of its own."""
    with StageClient(socket=served.socket) as stage:
        stage.status()

        def ask() -> set[str]:
            return {each for _ in range(50) for each in stage.status().document}

        mine, its = FORK.Pipe()
        child = FORK.Process(target=lambda: its.send(sorted(ask())))
        child.start()
        configs = [json.dumps(stage.config()) for _ in range(50)]
        assert mine.poll(WITHIN_S)
        assert {"state", "axes"} <= set(mine.recv())
        child.join()
        assert len(set(configs)) == 1


def test_child_that_leaves_the_blocks_ends_nothing_of_its_parent(served: Served) -> None:
    """A child may run to the end of a `with` that its parent is still in."""
    with StageClient(socket=served.socket, name="owner") as stage, stage.session():

        def end() -> str:
            stage.close()
            return "closed"

        assert told(end) == "closed"
        assert stage.status().state
        assert requests.Stop() not in served.stage.requests
    eventually(lambda: free(served))


def test_telemetry_of_the_parent_is_refused_in_words(served: Served) -> None:
    """What the parent has begun is no business of the child, and goes on in the parent."""
    served.stage.reader.waiting.extend(np.zeros(1, record_dtype(2)) for _ in range(20))
    with StageClient(socket=served.socket) as stage:
        intervals = stage.telemetry(50.0)
        next(intervals)
        assert "forked" in told(lambda: next(intervals).document and "an interval")
        assert next(intervals).axes
        intervals.close()


def test_child_uses_the_client_for_asyncio(served: Served) -> None:
    """In the loop of the child a client of the parent opens its own connection."""

    @asynccontextmanager
    async def client() -> AsyncIterator[AsyncStageClient]:
        async with AsyncStageClient(socket=served.socket) as stage:
            await stage.status()
            yield stage

    async def run() -> tuple[str, str]:
        async with client() as stage:

            async def ask() -> str:
                return (await stage.status()).state

            return await asyncio.to_thread(told, lambda: asyncio.run(ask())), await ask()

    child, parent = asyncio.run(run())
    assert child == parent


def test_error_of_a_foreign_stream_is_a_client_error() -> None:
    """Programs that handle errors of the client handle this one."""
    from piezod.client.own_connection import _Owned  # noqa: PLC0415 - slow

    owned = _Owned(None)
    owned._pid = 0  # noqa: SLF001 - as if forked
    with pytest.raises(ClientError, match="forked"):
        owned._check()  # noqa: SLF001 - see above
