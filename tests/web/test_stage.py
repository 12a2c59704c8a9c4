"""The stream of one stage, without a server of the page."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.web.rows import Decimator, Row
from piezod.web.stage import WebStage
from tests.client.fake_daemon import FakeDaemon, interval


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    """Return a daemon whose telemetry is one interval for each stream."""
    daemon = FakeDaemon(tmp_path / "api.sock")
    daemon.telemetry = [interval()]
    with daemon.running():
        yield daemon


def streams(daemon: FakeDaemon) -> int:
    """Return the number of streams that were opened."""
    return sum(each.what.startswith("GET telemetry") for each in daemon.asked)


def test_tab_that_watches_while_the_stream_closes_gets_rows(daemon: FakeDaemon) -> None:
    """A stream that ends when a new tab comes is opened again, also at another socket."""

    async def run() -> tuple[int, int]:
        stage = WebStage("bench", daemon.socket_path, "web", lambda _text: None)
        rows: asyncio.Queue[Row] = asyncio.Queue()
        stage.watch("tab", Decimator(30.0, rows.put_nowait))
        await rows.get()
        before = streams(daemon)
        stage.unwatch("tab")
        stage.watch("other", Decimator(30.0, rows.put_nowait))
        await rows.get()
        await stage.relocate(daemon.socket_path)
        stage.watch("third", Decimator(30.0, rows.put_nowait))
        await rows.get()
        await stage.close()
        return before, streams(daemon)

    before, after = asyncio.run(run())
    assert before == 1
    assert after > 2
