"""A recording on its way from a daemon to a browser."""

from contextlib import AsyncExitStack
from typing import Final

from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from piezod.web.errors import PageError, refused_file
from piezod.web.stages import Stages

_FROM_DAEMON: Final = ("content-disposition", "content-length", "content-type")


class DownloadAnswer(Response):
    """The file of a recording as the daemon sends it, or its error document.

    Args:
        stages: All stages.
        stage: Name of the stage.
        name: Name of the recording.
    """

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
