"""A program that has forked: `multiprocessing` and the sockets that its children inherit."""

import asyncio
import json
import multiprocessing
import os
import signal
import socket
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezod.client import AsyncStageClient, StageClient, StageGroup
from piezod.daemon.service.connection import ConnectionLimits
from piezod.messages import requests
from piezod.telemetry.arrays import record_dtype
from tests.daemon.service.fakes import Served
from tests.daemon.waiting import eventually
from tests.web.browser import Web
from tests.web.remote import Remote, new_certificate

FORK = multiprocessing.get_context("fork")
PROGRAM = multiprocessing.get_context("forkserver")
"""Programs are no forks of the tests, whose threads may hold a lock just then."""
WITHIN_S = 20.0


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """Return a service whose stage accepts everything."""
    served = Served(tmp_path, ConnectionLimits())
    with served.running():
        yield served


def sleeper() -> multiprocessing.context.ForkProcess:
    """Start a child that does nothing, as a worker of `multiprocessing` between two tasks."""
    child = FORK.Process(target=signal.pause, daemon=True)
    child.start()
    return child


@contextmanager
def started(
    run: Callable[[Any, Connection], None], place: Any
) -> "Iterator[tuple[multiprocessing.context.ForkServerProcess, int]]":
    """Run a program in a process that forks once; yield it and its child's number.

    The child lives until the end of the block.
    """
    mine, its = PROGRAM.Pipe()
    process = PROGRAM.Process(target=run, args=(place, its))
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
        signal.pause()  # until it is killed


def own_in_group(place: Path, its: Connection) -> None:
    """Own a session of a group."""
    with StageGroup(["bench"], name="owner") as group:
        group._clients["bench"] = StageClient(socket=place, name="owner")  # noqa: SLF001 - no name
        with group.session():
            its.send(sleeper().pid)
            signal.pause()  # until it is killed


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
        signal.pause()  # until it is killed


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
        signal.pause()  # until it is killed


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


def test_session_over_the_network_ends_with_its_owner(served: Served, tmp_path: Path) -> None:
    """No daemon sees the process on another computer, but its child has let go of the socket."""
    web = Web(lambda: {"bench": served.socket}, new_certificate(tmp_path))
    with web.running(), started(own_there, Remote(web, tmp_path).environ()) as (owner, _):
        eventually(lambda: served.app.state.service.lease.held)
        owner.kill()
        owner.join()
        eventually(lambda: free(served))


def own_there(environ: dict[str, str], its: Connection) -> None:
    """Own a session of a stage on another computer."""
    os.environ.update(environ)
    with StageClient(name="owner") as stage, stage.session():
        its.send(sleeper().pid)
        signal.pause()  # until it is killed


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


def outcome(run: Callable[[Path], Any], served: Served) -> Any:
    """Run a program in a process without threads, which may fork; return its result."""
    mine, its = PROGRAM.Pipe()
    process = PROGRAM.Process(target=report, args=(run, served.socket, its))
    process.start()
    assert mine.poll(2 * WITHIN_S)
    found = mine.recv()
    process.join(WITHIN_S)
    return found


def report(run: Callable[[Path], Any], place: Path, its: Connection) -> None:
    """Send the result of a program."""
    its.send(run(place))


def ask_together(place: Path) -> tuple[bool, list[str]]:
    """Let parent and child ask for different documents at the same time."""
    with StageClient(socket=place) as stage:
        stage.status()
        mine, its = FORK.Pipe()

        def ask() -> None:
            its.send(all("state" in stage.status().document for _ in range(50)))

        child = FORK.Process(target=ask)
        child.start()
        configs = {json.dumps(stage.config()) for _ in range(50)}
        return mine.poll(WITHIN_S) and mine.recv(), sorted(configs)


def test_parent_and_child_get_their_own_answers(served: Served) -> None:
    """Both use one client at the same time: the child has a connection of its own."""
    child, configs = outcome(ask_together, served)
    assert child
    assert len(configs) == 1


def close_in_child(place: Path) -> tuple[Any, str]:
    """Let a child close the client while its parent has a session."""
    with StageClient(socket=place, name="owner") as stage, stage.session():
        answer = told(stage.close)
        stage.arm()
        return answer, stage.status().document["lease"]["holder"]["client"]


def test_child_that_closes_the_client_ends_nothing_of_its_parent(served: Served) -> None:
    """A child may run to the end of a `with` that its parent is still in."""
    assert outcome(close_in_child, served) == (None, "owner")
    eventually(lambda: free(served))
    assert [each.kind for each in served.stage.requests] == ["arm", "stop"]


def read_together(place: Path) -> tuple[Any, int]:
    """Let a child go on with the telemetry of its parent."""
    with StageClient(socket=place) as stage, closing(stage.telemetry(50.0)) as intervals:
        next(intervals)
        return told(lambda: len(next(intervals).axes)), len(next(intervals).axes)


def test_telemetry_of_the_parent_is_refused_in_words(served: Served) -> None:
    """What the parent has begun is no business of the child, and goes on in the parent."""
    served.stage.reader.waiting.extend(np.zeros(1, record_dtype(2)) for _ in range(20))
    child, axes = outcome(read_together, served)
    assert axes == 2
    assert "ClientError" in child
    assert "forked" in child


def ask_async(place: Path) -> tuple[Any, str]:
    """Let a child of a program with asyncio use the client of its parent in a loop of its own."""

    async def run() -> tuple[Any, str]:
        async with AsyncStageClient(socket=place) as stage:
            before = (await stage.status()).state

            async def ask() -> str:
                return (await stage.status()).state

            return told(lambda: in_thread(ask)), (await stage.status()).state and before

    return asyncio.run(run())


def in_thread(ask: Callable[[], Coroutine[Any, Any, str]]) -> str:
    """Run a coroutine in a loop of another thread, since this one has a loop of its parent."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, ask()).result(WITHIN_S)


def test_child_uses_the_client_for_asyncio(served: Served) -> None:
    """A client of the parent opens its own connection in the child."""
    child, parent = outcome(ask_async, served)
    assert child == parent
