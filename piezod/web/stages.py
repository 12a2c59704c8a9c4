"""All stages of this machine, and all tabs that look at them."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Iterable
from contextlib import aclosing, asynccontextmanager, suppress
from pathlib import Path
from typing import Final, Protocol

from piezod.client.places import running_stages
from piezod.messages.documents import Document
from piezod.web.connections import Connections
from piezod.web.errors import AMBIGUOUS, NOT_FOUND, NOT_RUNNING, PageError
from piezod.web.job_commands import LookAtJob
from piezod.web.jobs import Jobs
from piezod.web.messages import ReadRecording
from piezod.web.recording_reader import RecordingReader
from piezod.web.rows import encoded
from piezod.web.stage import WebStage
from piezod.web.uploads import Uploads

LOOK_EACH_S: Final = 3.0
"""Time between two looks for new stages, in s."""


class Listener(Protocol):
    """A tab, as far as events are concerned."""

    def put(self, text: str) -> None:
        """Send an event."""
        ...


class Stages:
    """The stages. Nothing is asked of them while no tab is open.

    Args:
        client: Name of this server.
        find: Returns the sockets of the running daemons, by the names of their stages.

    Attributes:
        jobs: Identification, learning and replays, which go on when a tab is closed.
        uploads: The files that pages have sent.
    """

    def __init__(self, client: str, find: Callable[[], dict[str, Path]] = running_stages) -> None:
        self.client, self._find = client, find
        self._changing = asyncio.Lock()
        self._tabs: set[Listener] = set()
        self._stages: dict[str, WebStage] = {}
        self._looking: asyncio.Task[None] | None = None
        self._recordings = RecordingReader()
        self.jobs, self.uploads = Jobs(self.publish), Uploads()

    @property
    def tabs(self) -> int:
        """Number of open tabs."""
        return len(self._tabs)

    async def enter(self, tab: Listener) -> None:
        """Add a tab; it gets all events from now on."""
        self._tabs.add(tab)
        async with self._changing:
            if self._looking is None:
                await self._look()
                self._looking = asyncio.get_running_loop().create_task(self._keep_looking())

    async def leave(self, tab: Listener) -> None:
        """Remove a tab; after the last one, all connections are closed."""
        self._tabs.discard(tab)
        async with self._changing:
            for stage in self.all():
                stage.unwatch(tab)
            if self._tabs or self._looking is None:
                return
            looking, self._looking = self._looking, None
            looking.cancel()
            with suppress(asyncio.CancelledError):
                await looking
            stages, self._stages = self.all(), {}
            for stage in stages:
                await stage.close()
            await self._recordings.aclose()

    def all(self) -> list[WebStage]:
        """Return all stages that were found, also those that are down since, by name."""
        return [self._stages[name] for name in sorted(self._stages)]

    def named(self, name: str) -> WebStage:
        """Return a stage.

        Raises:
            PageError: If no daemon of that name was found.
        """
        if name not in self._stages:
            raise _unknown(name, self._stages)
        return self._stages[name]

    async def read(self, wanted: ReadRecording) -> Document:
        """Return a part of a recording.

        Raises:
            PageError: If there is no such recording, or it cannot be read.
        """
        socket = self.named(wanted.stage).connections.socket
        request = wanted.model_dump(exclude={"id", "do", "stage"})
        return await self._recordings.ask({**request, "what": wanted.do, "socket": str(socket)})

    def look_at_job(self, wanted: LookAtJob) -> Document:
        """Return the newest job of a stage, after ending it if that is wanted.

        Raises:
            PageError: If there is no such stage.
        """
        stage = self.named(wanted.stage).name
        return self.jobs.end(stage) if wanted.do == "end_job" else self.jobs.document(stage)

    @asynccontextmanager
    async def visiting(self, name: str | None) -> AsyncGenerator[Connections, None]:
        """Yield connections to a daemon for one use, which needs no open tab.

        Args:
            name: Name of the stage; None for the only one.

        Raises:
            PageError: If no daemon of that name runs, or several and none is named.
        """
        sockets = await asyncio.to_thread(self._find)
        if name is None:
            name = _only(sockets)
        if name not in sockets:
            raise _unknown(name, sockets)
        async with aclosing(Connections(sockets[name], self.client)) as connections:
            yield connections

    async def metrics(self) -> list[str]:
        """Return the metrics of each stage whose daemon runs and answers."""
        texts = []
        for name in await asyncio.to_thread(self._find):
            with suppress(PageError):
                async with self.visiting(name) as connections:
                    texts.append(await connections.metrics())
        return texts

    def publish(self, text: str) -> None:
        """Send an event to all tabs."""
        for tab in tuple(self._tabs):
            tab.put(text)

    async def _keep_looking(self) -> None:
        while True:
            await asyncio.sleep(LOOK_EACH_S)
            with suppress(OSError):  # no descriptor is free just now
                await self._look()

    async def _look(self) -> None:
        """Add the stages that have started; one may also have another socket than before."""
        for name, socket in (await asyncio.to_thread(self._find)).items():
            known = self._stages.get(name)
            if known is not None and (known.up or known.connections.socket == socket):
                continue
            if known is not None:
                await known.relocate(socket)
                continue
            stage = self._stages[name] = WebStage(name, socket, self.client, self.publish)
            self.publish(encoded({"event": "stage", **stage.document()}))


def _only(sockets: dict[str, Path]) -> str:
    if not sockets:
        raise PageError(NOT_RUNNING, "no daemon is running on this machine", "start it there")
    if len(sockets) > 1:
        what = f"several stages are running: {', '.join(sorted(sockets))}"
        raise PageError(AMBIGUOUS, what, "name one in the address: /stages/NAME/v1/…")
    return next(iter(sockets))


def _unknown(name: str, known: Iterable[str]) -> PageError:
    what = f"no stage {name[:64]!r} on this machine"
    return PageError(NOT_FOUND, what, f"stages: {', '.join(sorted(known)) or 'none'}")
