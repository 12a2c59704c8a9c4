"""The client for programs that run under asyncio; `StageClient` is the same for all others."""

from collections.abc import Callable, Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

import httpx

from piezod.client import calls
from piezod.client.calls import Call
from piezod.client.errors import translated
from piezod.client.places import find_socket
from piezod.client.wire import BASE_URL, TIMEOUT, as_method, headers, new_name, read_answer

ParametersT = ParamSpec("ParametersT")
ResultT = TypeVar("ResultT")


def _method(
    make: Callable[ParametersT, Call[ResultT]],
) -> Callable[Concatenate["AsyncStageClient", ParametersT], Coroutine[Any, Any, ResultT]]:
    async def method(
        self: "AsyncStageClient", /, *args: ParametersT.args, **kwargs: ParametersT.kwargs
    ) -> ResultT:
        return await self.call(make(*args, **kwargs))

    return as_method(method, make)


class AsyncStageClient:
    """A connection to the daemon of one stage; use it in an `async with` statement.

    ::

        async with AsyncStageClient() as stage:
            await stage.arm()
            await stage.mode("adaptive")
            await stage.goto_and_wait(12.5)

    For several tasks at a time, in one event loop. Arguments, results and errors are those of
    `StageClient`.

    Args:
        stage: Name of the stage; left out: `PIEZOD_STAGE`, or the only one that runs.
        socket: Path of the daemon's socket, in place of a name.
        name: What the daemon calls this client; the lease belongs to user and name. Left out: a
            name that no other client has.

    Raises:
        NotRunningError: If no daemon listens.
        AmbiguousStageError: If several do, and none is named.
    """

    def __init__(
        self, stage: str | None = None, *, socket: Path | None = None, name: str | None = None
    ) -> None:
        self.socket = socket or find_socket(stage)
        self.name = name or new_name()
        self._http = httpx.AsyncClient(
            transport=httpx.AsyncHTTPTransport(uds=str(self.socket)),
            base_url=BASE_URL,
            headers=headers(self.name),
            timeout=TIMEOUT,
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connection; the stage goes on with what it does."""
        await self._http.aclose()

    async def call(self, call: Call[ResultT]) -> ResultT:
        """Carry out one call of `piezod.client.calls`."""
        with translated(self.socket):
            response = await self._http.request(call.method, call.path, json=call.body)
        return read_answer(call, response)

    status = _method(calls.status)
    arm = _method(calls.arm)
    disarm = _method(calls.disarm)
    mode = _method(calls.mode)
    goto = _method(calls.goto)
    wave = _method(calls.wave)
    hold = _method(calls.hold)
    resume = _method(calls.resume)
    condition = _method(calls.condition)
    zero = _method(calls.zero)
    stop = _method(calls.stop)
    estop = _method(calls.estop)
    reset = _method(calls.reset)
    identify = _method(calls.identify)
    adopt = _method(calls.adopt)
    shutdown = _method(calls.shutdown)
