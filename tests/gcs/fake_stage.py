"""A stage behind a client of the daemon, without any process; and dialogues with it."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from piezod.client.calls import Call
from piezod.client.daemon_link import DaemonLink
from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.errors import ClientError, NotRunningError, RefusedError
from piezod.gcs.readings import Readings
from piezod.gcs.session import GcsSession

ResultT = TypeVar("ResultT")
IDENTITY = "(c)2026 piezod, piezod bench, 0, 1.2.3"


class FakeStage:
    """Carries requests out at once; a test changes its state, and makes it refuse.

    Attributes:
        state: Its state.
        axes: Status of each axis.
        requests: What was requested: client, path and body.
        errors: Error of each path.
        held: Events, by path, for which the next request of this path waits.
        holder: Name of the client with the lease.
    """

    def __init__(self, *names: str) -> None:
        self.state = "SAFE"
        self.axes: dict[str, dict[str, Any]] = {
            name: {
                "position_um": 1.5,
                "command_um": None,
                "drive_v": 20.25,
                "target_um": None,
                "mode": "feedforward",
                "on_target": False,
                "motion": 0,
            }
            for name in names
        }
        self.requests: list[tuple[str, str, dict[str, Any]]] = []
        self.errors: dict[str, ClientError] = {}
        self.held: dict[str, asyncio.Event] = {}
        self.holder = ""
        self.config: dict[str, Any] = {
            "axes": {
                name: {
                    "command_range_um": [0.0, 20.0],
                    "limits": {"drive_min_v": 0.0, "drive_max_v": 150.0},
                    "sensor": {},
                }
                for name in names
            }
        }

    def answer(self, client: str, path: str, body: dict[str, Any]) -> dict[str, Any]:
        """Carry out one request; return the document."""
        if path in self.errors:
            raise self.errors[path]
        if path == "config":
            return self.config
        if path == "status":
            axes = {name: dict(axis) for name, axis in self.axes.items()}
            document = {"state": self.state, "mode": "mixed", "faults": [], "axes": axes}
            return {**document, "skipped_cycles": 0, "stage": "bench"}
        self.requests.append((client, path, body))
        getattr(self, f"_{path}", lambda _: None)(body)
        return {"motion": 0, "state": self.state, "name": "of a recording"}

    def do(self, path: str) -> list[dict[str, Any]]:
        """Return the bodies of the requests of one path."""
        return [body for _, each, body in self.requests if each == path]

    def paths(self) -> list[str]:
        """Return the paths of all requests."""
        return [path for _, path, _ in self.requests]

    def _arm(self, _: dict[str, Any]) -> None:
        self.state = "READY"
        for axis in self.axes.values():
            axis["command_um"] = axis["target_um"] = axis["position_um"]
            axis["on_target"] = True

    def _mode(self, body: dict[str, Any]) -> None:
        self.state = "RUN"
        self.axes[body["axis"]]["mode"] = body["mode"]

    def _goto(self, body: dict[str, Any]) -> None:
        if self.state == "HOLD":
            raise RefusedError("cannot move in HOLD", "", "refused")
        axis = self.axes[body["axis"]]
        axis.update(target_um=body["position_um"], on_target=False, motion=axis["motion"] + 1)

    def _hold(self, _: dict[str, Any]) -> None:
        if self.state == "SAFE":
            raise RefusedError("nothing is driven in SAFE", "", "refused")
        self.state = "HOLD"

    def _resume(self, _: dict[str, Any]) -> None:
        self.state = "RUN"


class FakeLink(DaemonLink):
    """A client whose calls reach a `FakeStage`."""

    def __init__(self, stage: FakeStage, name: str) -> None:
        super().__init__(Path("api.sock"), name)
        self._stage, self._client_name = stage, name

    async def _call(self, call: Call[ResultT]) -> ResultT:
        self._commanded = self._commanded or call.endpoint.access.lease
        path = call.endpoint.path
        if path in self._stage.held:
            await self._stage.held.pop(path).wait()
        return call.read(self._stage.answer(self._client_name, path, dict(call.body or {})))


class Dialogue:
    """One client of a controller.

    Args:
        controller: Its parts.
        name: Name of its client of the daemon.
    """

    def __init__(self, controller: "Controller", name: str) -> None:
        link = FakeLink(controller.stage, name)
        self._run, self._stage = controller.runner.run, controller.stage
        self.reports: list[str] = []
        self._replies = b""
        mover, readings = StageMover(link), controller.readings
        self._session = GcsSession(
            mover, readings, "trimmed", IDENTITY, self.reports.append, self._receive
        )
        self._working = self._run(self._begun())

    async def _begun(self) -> "asyncio.Task[None]":
        return asyncio.create_task(self._session.work())

    async def _receive(self, reply: bytes) -> None:
        self._replies += reply

    def send(self, data: bytes) -> bytes:
        """Send bytes; return the replies."""
        return self._run(self._answered(data))

    async def _answered(self, data: bytes) -> bytes:
        self._session.take(data)
        await self._session.waiting.join()
        replies, self._replies = self._replies, b""
        return replies

    def ask(self, line: str) -> str:
        """Send a line; return the reply, empty for none."""
        return self.send(line.encode() + b"\n").decode("cp1252")

    def error_of(self, line: str) -> int:
        """Send a line that has no reply; return the error that `ERR?` then reports."""
        assert self.ask(line) == ""
        return int(self.ask("ERR?"))

    def send_meanwhile(self, first: bytes, then: bytes, held: asyncio.Event) -> bytes:
        """Send bytes, and others while a request of the first waits; return all replies."""

        async def sent() -> bytes:
            await self._asked(first)
            self._session.take(then)
            await asyncio.sleep(0.01)  # whatever waits for nothing else is done by then
            held.set()
            return await self._answered(b"")

        return self._run(sent())

    def leave(self, data: bytes, held: asyncio.Event) -> None:
        """Send bytes, and close the connection while a request of them waits."""

        async def left() -> None:
            await self._asked(data)
            self._working.cancel()
            await asyncio.wait({self._working})
            held.set()
            await self._session.close()

        self._run(left())

    async def _asked(self, data: bytes) -> None:
        """Send bytes; return when a request waits."""
        self._session.take(data)
        while self._stage.held:
            await asyncio.sleep(0.001)

    def close(self) -> None:
        """Close the connection."""
        self._working.cancel()
        self._run(self._session.close())


class Controller:
    """A stage as a controller.

    Args:
        names: Names of its axes.
    """

    def __init__(self, *names: str) -> None:
        self.stage = FakeStage(*names)
        self.runner = asyncio.Runner()
        self.readings = Readings(StageMirror(FakeLink(self.stage, "gcs")), "trimmed")

    def client(self, name: str = "gcs:1") -> Dialogue:
        """Return a new connection."""
        return Dialogue(self, name)

    def held(self, path: str) -> asyncio.Event:
        """Return an event for which the next request of a path waits before it is carried out."""
        event = self.stage.held[path] = asyncio.Event()
        return event

    @contextmanager
    def changing(self) -> Iterator[FakeStage]:
        """Give the stage to be changed from outside; the next query sees the change."""
        yield self.stage
        self.readings.mirror.expire()


def gone() -> NotRunningError:
    """Return the error of a daemon that has ended."""
    return NotRunningError("api.sock: the daemon has ended", "check that it still runs")
