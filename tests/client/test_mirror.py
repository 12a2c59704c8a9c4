"""A stage as adapters see it, and what a stop means for the movements of a client."""

import asyncio
from collections.abc import Coroutine, Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest

from piezod.client import AsyncStageClient, StageClient
from piezod.client import mirror as mirror_module
from piezod.client.arrival import ARRIVAL_MARGIN_S, Arrival
from piezod.client.daemon_link import DaemonLink
from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.errors import ClientError, NotReachedError, NotRunningError
from piezod.messages.telemetry import Telemetry
from tests.client.fake_daemon import FakeDaemon, Raw, interval
from tests.gcs.fake_stage import FakeLink, FakeStage

ResultT = TypeVar("ResultT")


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    """Return a daemon whose telemetry ends after one interval."""
    daemon = FakeDaemon(tmp_path / "api.sock")
    daemon.telemetry = [interval()]
    with daemon.running():
        yield daemon


@pytest.fixture
def stage() -> FakeStage:
    """Return a stage in RUN with the axes x and y."""
    stage = FakeStage("x", "y")
    stage.state = "RUN"
    return stage


def asked(daemon: FakeDaemon, what: str) -> int:
    """Return how often something was requested."""
    return sum(each.what.startswith(what) for each in daemon.asked)


@pytest.mark.parametrize("asynchronous", [False, True])
def test_goto_waits_as_long_as_it_takes(daemon: FakeDaemon, *, asynchronous: bool) -> None:
    """Without a time-out of the caller, the daemon's duration decides how long it waits."""

    async def moved() -> Arrival:
        async with AsyncStageClient(socket=daemon.socket_path) as client:
            return await client.goto_and_wait(12.5)

    def arrive() -> float:
        if asynchronous:
            return asyncio.run(moved()).position_um
        with StageClient(socket=daemon.socket_path) as client:
            return client.goto_and_wait(12.5).position_um

    daemon.answers["POST goto"] = {"accepted": True, "motion": 7, "duration_s": -ARRIVAL_MARGIN_S}
    with pytest.raises(NotReachedError, match="not on target within 0 s"):
        arrive()

    daemon.answers["POST goto"] = {"accepted": True, "motion": 7, "duration_s": 3600.0}
    daemon.telemetry = [interval(), interval(12.5, on_target=True)]
    assert arrive() == 12.5


def test_those_who_look_together_share_status_and_stream(daemon: FakeDaemon) -> None:
    """Ten that ask for the status share a request, and ten listeners a stream."""

    async def look() -> None:
        link = DaemonLink(daemon.socket_path, "test")
        mirror = StageMirror(link)
        await asyncio.gather(*(mirror.status() for _ in range(10)))
        async with mirror.listening() as first, mirror.listening() as second:
            await asyncio.gather(anext(first), anext(second))
        await link.close()

    asyncio.run(look())
    assert (asked(daemon, "GET status"), asked(daemon, "GET telemetry")) == (1, 1)


def test_status_is_newer_than_the_last_command(daemon: FakeDaemon) -> None:
    """One that is young enough is used again, but not after a command."""

    async def look() -> None:
        link = DaemonLink(daemon.socket_path, "test")
        mirror = StageMirror(link)
        await mirror.status()
        await mirror.status(max_age_s=60.0)
        mirror.expire()
        await mirror.status(max_age_s=60.0)
        await link.close()

    asyncio.run(look())
    assert asked(daemon, "GET status") == 2


def test_telemetry_comes_back_after_an_end_and_a_refusal(daemon: FakeDaemon) -> None:
    """Who follows a stage gets the reason, and then intervals again."""
    kinds: list[type] = []

    async def follow() -> None:
        link = DaemonLink(daemon.socket_path, "test")
        async for found in StageMirror(link).following():
            kinds.append(type(found))
            if len(kinds) == 2:
                daemon.answers["GET telemetry"] = Raw(503, b"{}")
                daemon.telemetry.clear()
            if len(kinds) == 3:
                daemon.telemetry.append(interval())
            if len(kinds) == 4:
                break

    asyncio.run(follow())
    assert kinds == [Telemetry, NotRunningError, ClientError, Telemetry]


def test_silence_is_an_error(daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """A daemon that is there and sends nothing does not answer."""
    monkeypatch.setattr(mirror_module, "SILENT_S", 0.05)
    daemon.answering.clear()

    async def listen() -> None:
        async with StageMirror(DaemonLink(daemon.socket_path, "test")).listening() as intervals:
            await anext(intervals)

    with pytest.raises(ClientError, match="sends no telemetry") as caught:
        asyncio.run(listen())
    assert caught.value.code == "no_answer"


def meanwhile(
    stage: FakeStage, mover: StageMover, moving: Coroutine[Any, Any, object], *stops: bool
) -> None:
    """Move; stop while the first request waits at the daemon, resuming or not."""

    async def run() -> None:
        stage.held["goto"] = asyncio.Event()
        held, task = stage.held["goto"], asyncio.ensure_future(moving)
        while stage.held:
            await asyncio.sleep(0)
        stopping = [asyncio.ensure_future(mover.stop("RUN", resume=each)) for each in stops]
        while "hold" not in stage.paths():
            await asyncio.sleep(0)
        held.set()
        assert await asyncio.gather(*stopping) == [True] * len(stops)
        with pytest.raises(NotReachedError) as caught:
            await task
        assert caught.value.code == "stopped"

    asyncio.run(run())


def test_stop_drops_what_has_not_begun(stage: FakeStage) -> None:
    """The hold waits for nothing, and nothing moves after it; then the stage resumes."""
    mover = StageMover(FakeLink(stage, "test"))
    meanwhile(stage, mover, mover.goto({"x": 1.0, "y": 2.0}), True)

    assert stage.paths() == ["hold", "goto", "resume"]


def test_newest_stop_decides_whether_the_stage_resumes(stage: FakeStage) -> None:
    """A stop that shall resume does not undo a later one that shall not."""
    mover = StageMover(FakeLink(stage, "test"))
    meanwhile(stage, mover, mover.goto({"x": 1.0}), True, False)

    assert stage.state == "HOLD"


@pytest.mark.parametrize(("state", "resumed"), [("RUN", True), ("", True), ("HOLD", False)])
def test_only_who_has_held_the_stage_resumes_it(
    stage: FakeStage, state: str, resumed: bool
) -> None:
    """A hold of somebody else stays: at once, and at the next movement."""
    mover = StageMover(FakeLink(stage, "test"))

    async def stop_and_go_on() -> None:
        await mover.stop(state, resume=False)
        await mover.go_on()

    asyncio.run(mover.stop(state, resume=True))
    at_once = stage.state
    asyncio.run(stop_and_go_on())
    assert (at_once == "RUN", stage.state == "RUN") == (resumed, resumed)


def test_lease_is_kept_until_each_keeper_has_returned_it(stage: FakeStage) -> None:
    """It is released once; who keeps it already and takes it again learns whether it is there."""
    mover = StageMover(FakeLink(stage, "test"))

    async def keep() -> None:
        await mover.take_lease("a")
        await mover.take_lease("a")
        async with mover.commanding():
            await mover.return_lease("a")

    asyncio.run(keep())
    assert stage.paths() == ["lease"] * 3
