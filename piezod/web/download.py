"""The file of a recording, for as long as its client stays."""

import asyncio
from collections.abc import Coroutine
from contextlib import AsyncExitStack
from typing import Any, Final

from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from piezod.web.errors import PageError, refused_file
from piezod.web.stages import Stages


async def while_connected(
    serving: Coroutine[Any, Any, None],
    leaving: Coroutine[Any, Any, None],
    *expected: type[Exception],
) -> None:
    """Serve a client until that is done or it has left.

    Args:
        serving: Serves it; cancelled if it leaves.
        leaving: Ends when it leaves.
        expected: Errors of either that end it and are not raised.
    """
    tasks = asyncio.create_task(serving), asyncio.create_task(leaving)
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        ended = await asyncio.gather(*tasks, return_exceptions=True)
    for each in ended:
        if isinstance(each, Exception) and not isinstance(each, expected):
            raise each


_FROM_DAEMON: Final = ("content-disposition", "content-length", "content-type")


class DownloadAnswer(Response):
    """The file of a recording as the daemon sends it, or its error document."""

    def __init__(self, stages: Stages, stage: str, name: str) -> None:
        super().__init__()
        self._stages, self._stage, self._name = stages, stage, name

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the file block by block, as fast as the browser reads."""
        async with AsyncExitStack() as stack:
            answer: Response
            try:
                connections = await stack.enter_async_context(self._stages.visiting(self._stage))
                found = await stack.enter_async_context(connections.recording(self._name))
                names = {name.decode().lower(): value.decode() for name, value in found.headers}
                headers: dict[str, str] = {
                    name: names[name] for name in _FROM_DAEMON if name in names
                }
                answer = StreamingResponse(found.aiter_stream(), headers=headers)
            except PageError as error:
                answer = refused_file(error, scope)
            await answer(scope, receive, send)
