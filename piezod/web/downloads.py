"""Download of a recording: the answer of the daemon, passed on piece by piece."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from typing import Final

import httpcore
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse

from piezod.client.errors import translated
from piezod.client.wire import http_request, is_error, recording_path
from piezod.errors import ClientError
from piezod.web.errors import PageError, of_answer, of_connection
from piezod.web.stages import Stages

PATH: Final = "/recordings/{stage}/{name}.h5"
_KEPT: Final = ("content-length", "content-disposition")


async def download(request: Request, stages: Stages) -> Response:
    """Return the file of a recording as it arrives, or an error with its document.

    Args:
        request: A request for `PATH`.
        stages: All stages.
    """
    async with AsyncExitStack() as stack:
        try:
            socket = stages.named(request.path_params["stage"]).connections.socket
            pool = await stack.enter_async_context(httpcore.AsyncConnectionPool(uds=str(socket)))
            wanted = http_request("GET", recording_path(request.path_params["name"]), stages.client)
            with translated(socket):
                answer = await stack.enter_async_context(pool.stream(**wanted))
                if is_error(answer):
                    await answer.aread()
                    raise of_answer(answer)
        except ClientError as error:
            return JSONResponse({"error": of_connection(error).document}, 502)
        except PageError as error:
            return JSONResponse({"error": error.document}, 404)
        opened = stack.pop_all()
    headers = {name.decode().lower(): value.decode() for name, value in answer.headers}
    return StreamingResponse(
        _pieces(answer, opened),
        media_type="application/x-hdf5",
        headers={name: headers[name] for name in _KEPT if name in headers},
    )


async def _pieces(answer: httpcore.Response, opened: AsyncExitStack) -> AsyncIterator[bytes]:
    async with opened:
        async for piece in answer.aiter_stream():
            yield piece
