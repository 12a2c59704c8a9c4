"""The stream of one stage, without a daemon."""

import asyncio
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import cast

from piezod.messages.documents import Document
from piezod.web.connections import Connections
from piezod.web.rows import Pacer, Row
from piezod.web.stage import WebStage
from tests.client.fake_daemon import STATUS, interval


class SlowConnections:
    """Connections whose telemetry takes time to close."""

    def __init__(self) -> None:
        self.opened = 0
        self.closing, self.may_close = asyncio.Event(), asyncio.Event()

    async def aclose(self) -> None:
        self.may_close.set()

    async def status(self) -> Document:
        return STATUS

    async def telemetry(self) -> AsyncGenerator[Document, None]:
        self.opened += 1
        try:
            while True:
                yield interval(t_s=float(self.opened))
                await asyncio.sleep(0)
        finally:
            self.closing.set()
            await self.may_close.wait()


def test_tab_that_watches_while_the_stream_closes_gets_rows() -> None:
    """A stream that is closing when a new tab comes is opened again."""

    async def run() -> int:
        stage = WebStage("bench", Path("unused"), "web", lambda _text: None)
        slow = SlowConnections()
        stage.connections = cast("Connections", slow)
        rows: asyncio.Queue[Row] = asyncio.Queue()
        stage.watch("tab", Pacer(30.0, rows.put_nowait))
        await rows.get()
        stage.unwatch("tab")
        await slow.closing.wait()

        stage.watch("other", Pacer(30.0, rows.put_nowait))
        slow.may_close.set()
        while (await rows.get()).document["t_s"] != 2.0:
            pass
        await stage.close()
        return slow.opened

    assert asyncio.run(run()) == 2
