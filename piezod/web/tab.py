"""One tab of a browser: one WebSocket for its requests, their answers, and all events."""

import asyncio
from collections import deque
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from piezod.client.wire import http_request
from piezod.messages.documents import Document
from piezod.messages.endpoints import Role
from piezod.messages.requests import TABLE
from piezod.web import messages
from piezod.web.errors import NOT_FOUND, PageError, require
from piezod.web.export import barriers
from piezod.web.job_commands import (
    IdentifyJob,
    ImportJob,
    JobMessage,
    LearnJob,
    LookAtJob,
    ReplayJob,
    ScanJob,
    of_file,
)
from piezod.web.rows import Decimator, Row, encoded, telemetry_event
from piezod.web.stage import WebStage
from piezod.web.stages import Stages

MOST_CALLS: Final = 8
"""Calls of a tab in progress, and as many emergency stops."""
MOST_WAITING: Final = 8 * 1024 * 1024
"""Text that may wait for a tab which does not read, in characters; more closes the tab."""
_LAST_CALLS_S: Final = 2.0
"""Time for the calls of a closed tab to end before its leases are released, in s."""


class Tab:
    """A tab, until its WebSocket closes. Then its leases are released.

    Args:
        name: Name for the lease, as other clients see it.
        socket: Its accepted WebSocket.
        stages: All stages.
        role: The largest role that it may use.
    """

    def __init__(self, name: str, socket: WebSocket, stages: Stages, role: Role) -> None:
        self.name, self._socket, self._stages = name, socket, stages
        self._role = role
        self._waiting: deque[str | Row] = deque()
        self._waiting_size = 0
        self._wake, self._closed = asyncio.Event(), asyncio.Event()
        self._watched: WebStage | None = None
        self._calls: set[asyncio.Task[None]] = set()
        self._stops: set[asyncio.Task[None]] = set()
        self._leased: set[str] = set()

    async def run(self) -> None:
        """Serve the tab until it closes, or does not read."""
        await self._stages.enter(self)
        works = [
            asyncio.create_task(each)
            for each in (self._send(), self._receive(), self._closed.wait())
        ]
        try:
            await asyncio.wait(works, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._closed.set()
            for work in works:
                work.cancel()
            ended = await asyncio.gather(*works, return_exceptions=True)
            await self._release()
            await self._stages.leave(self)
        for each in ended:
            if isinstance(each, Exception) and not isinstance(each, WebSocketDisconnect):
                raise each

    def put(self, item: str | Row) -> None:
        """Send an event or a row as soon as the tab reads; close a tab that does not."""
        size = len(item if isinstance(item, str) else item.text)
        if self._waiting_size + size > MOST_WAITING:
            self._closed.set()
        if self._closed.is_set():
            return
        self._waiting.append(item)
        self._waiting_size += size
        self._wake.set()

    def _next(self) -> str:
        """Take the next text to send: consecutive rows of a stage become one event."""
        item = self._waiting.popleft()
        if isinstance(item, str):
            self._waiting_size -= len(item)
            return item
        rows = [item]
        while self._waiting and isinstance(more := self._waiting[0], Row):
            if not item.fits(more):
                break
            rows.append(more)
            self._waiting.popleft()
        self._waiting_size -= sum(len(row.text) for row in rows)
        return item.text if len(rows) == 1 else telemetry_event(rows)

    async def _send(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._waiting:
                text = self._next()
                try:
                    await self._socket.send_text(text)
                except RuntimeError:  # uvicorn has closed it after a frame that is not allowed
                    return

    async def _receive(self) -> None:
        while True:
            received = await self._socket.receive()
            if received["type"] == "websocket.disconnect":
                return
            try:
                self._carry_out(messages.read(received.get("text") or ""))
            except PageError as error:
                self._answer(None, error)
            await asyncio.sleep(0)  # a tab that sends without pause delays no other one

    def _carry_out(self, message: messages.AnyMessage) -> None:
        try:
            match message:
                case messages.EmergencyStop():
                    stage = self._stages.named(message.stage)
                    request = http_request("POST", TABLE["estop"].path, self.name, body={})
                    work = stage.connections.call(request, urgent=True)
                    self._start(self._stops, message.id, work)
                case messages.CallStage():
                    self._start(self._calls, message.id, self._call(message))
                case messages.ReadRecording():
                    self._start(self._calls, message.id, self._stages.read(message))
                case IdentifyJob() | ImportJob() | LearnJob() | ScanJob() | ReplayJob():
                    self._start(self._calls, message.id, self._start_job(message))
                case LookAtJob():
                    require(self._role, Role.VIEWER if message.do == "job" else Role.OPERATOR)
                    self._answer(message.id, self._stages.look_at_job(message))
                case messages.ListStages():
                    self._answer(message.id, self._list())
                case messages.Watch():
                    self._answer(message.id, self._watch(message))
                case messages.Unwatch():
                    self._unwatch()
                    self._answer(message.id, {})
        except PageError as error:
            self._answer(message.id, error)

    def _start(
        self, running: set[asyncio.Task[None]], number: int, work: Coroutine[Any, Any, Document]
    ) -> None:
        """Carry out a call beside all others, so that none waits for it."""
        if len(running) >= MOST_CALLS:
            work.close()
            what = f"{len(running)} requests of this tab are in progress, allowed: {MOST_CALLS}"
            raise PageError("too_many", what, "wait for their answers")

        async def answered() -> None:
            try:
                self._answer(number, await work)
            except PageError as error:
                self._answer(number, error)

        task = asyncio.create_task(answered())
        running.add(task)
        task.add_done_callback(running.discard)

    async def _call(self, call: messages.CallStage) -> Document:
        stage, row = self._stages.named(call.stage), messages.row_of(call)
        require(self._role, row.access.role)
        request = messages.http_request_of(call, row, self.name)
        if row.access.lease:
            self._leased.add(call.stage)
        return await stage.connections.call(request)

    async def _start_job(self, wanted: JobMessage) -> Document:
        stage, model, upload = self._stages.named(wanted.stage), None, None
        if isinstance(wanted, ReplayJob):
            require(self._role, Role.OPERATOR)
            model = await self._present_model(stage, wanted.axis)
        elif of_file(wanted):
            require(self._role, Role.ENGINEER)
            upload = self._stages.uploads.path(stage.name)
        else:
            require(self._role, Role.ENGINEER)
            await self._release_lease(stage)  # the command needs it
        return self._stages.jobs.start(wanted, model, upload, stage.connections.socket)

    async def _present_model(self, stage: WebStage, axis: str) -> Document | None:
        """Return the model of an axis with its learned weights; None if it has none.

        Raises:
            PageError: If the stage has no such axis, or the daemon does not answer.
        """
        row = TABLE["params"]
        answer = await stage.connections.call(http_request(row.method, row.path, self.name))
        if axis not in answer["axes"]:
            axes = ", ".join(answer["axes"]) or "none"
            raise PageError(NOT_FOUND, f"stage {stage.name} has no axis {axis!r}", f"axes: {axes}")
        model: Document | None = answer["axes"][axis]["model"]
        return model

    def _list(self) -> Document:
        stages = [stage.document() for stage in self._stages.all()]
        return {
            "client": self.name,
            "role": self._role.name.lower(),
            "tables": barriers(),
            "stages": stages,
        }

    def _watch(self, message: messages.Watch) -> Document:
        stage = self._stages.named(message.stage)
        self._unwatch()
        self._watched = stage
        stage.watch(self, Decimator(message.rate_hz, self.put))
        return stage.document()

    def _unwatch(self) -> None:
        watched, self._watched = self._watched, None
        if watched is not None:
            watched.unwatch(self)

    def _answer(self, number: int | None, result: Document | PageError) -> None:
        if isinstance(result, PageError):
            self.put(encoded({"id": number, "ok": False, "error": result.document}))
        else:
            self.put(encoded({"id": number, "ok": True, "result": result}))

    async def _release(self) -> None:
        """End the calls, and release the leases: another client shall not wait for their end."""
        if running := (*self._calls, *self._stops):
            _, late = await asyncio.wait(running, timeout=_LAST_CALLS_S)
            for task in late:
                task.cancel()
        for name in tuple(self._leased):
            with suppress(PageError):
                await self._release_lease(self._stages.named(name))

    async def _release_lease(self, stage: WebStage) -> None:
        if stage.name not in self._leased:
            return
        self._leased.discard(stage.name)
        row = TABLE["release_lease"]
        with suppress(PageError):  # another client may have it by now
            await stage.connections.call(http_request(row.method, row.path, self.name))
