"""A stage that records requests only, and its service on a real socket."""

import asyncio
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from numpy.typing import NDArray

from piezod.config.states import State
from piezod.control.stage.answer import Answer
from piezod.daemon.service.access import LeaseKeeper, UrgentNotes, User
from piezod.daemon.service.app import bind, create_app, make_server
from piezod.daemon.service.connection import ConnectionLimits, Credentials
from piezod.daemon.service.request import OpenStreams, ServiceState
from piezod.daemon.stage.connection import FollowingReader
from piezod.daemon.stage.errors import NotNowError, UnavailableError, UnknownNameError
from piezod.daemon.stage.peer import AuditEntry, Peer
from piezod.daemon.stage.running_stage import RunningStage
from piezod.messages.answers import AxisStatus, Fault, Faults, Health, Realtime, Status
from piezod.messages.documents import Document
from piezod.messages.endpoints import Role
from piezod.messages.recording_edge import RecordingEdge
from piezod.messages.requests import Request
from piezod.messages.stores import (
    Audit,
    AuditLine,
    History,
    HistoryEntry,
    KeptRecording,
    Loaded,
    Parameters,
    Recording,
    RecordingFile,
    Recordings,
    Reloaded,
    RunningRecording,
    Saved,
)
from piezod.telemetry.arrays import record_dtype
from tests.daemon.daemons import NO_TLS
from tests.daemon.waiting import join

NAN = float("nan")


class FakeReader(FollowingReader):
    """Returns the records that a test has put into `waiting`, then `else_`."""

    def __init__(self) -> None:
        self.waiting: list[NDArray[Any]] = []
        self.else_: NDArray[Any] = np.zeros(0, record_dtype(2))
        self.lost = 0

    def read(self, limit: int) -> tuple[NDArray[Any], int]:
        records = self.waiting.pop(0) if self.waiting else self.else_
        return records[:limit], self.lost


class FakeStage(RunningStage):
    """Accepts everything, unless a test sets a refusal."""

    axes: Sequence[str] = ("x", "y")
    places: Mapping[str, int] = {"x": 0, "y": 1}
    recordings_folder = Path()

    def __init__(self, folder: Path) -> None:
        self.recordings_folder = folder
        self.requests: list[Request] = []
        self.setpoints: list[Mapping[str, float]] = []
        self.audited: list[AuditEntry] = []
        self.refusal = ""
        self.state_then = "SAFE"
        self.next_states: list[str] = []
        self.lost_link = False
        self.unanswered = self.recordings_stopped = 0
        self.stream_refusal = ""
        self.running: RunningRecording | None = None
        self.healthy = True
        self.more_faults: list[str] = []
        self.configuration: Document = {"rate_hz": 1000.0}
        self.reader = FakeReader()

    async def request(self, request: Request, peer: Peer) -> Answer:  # noqa: ARG002 - a protocol
        if self.lost_link:
            self.unanswered += 1
            raise UnavailableError("there is no loop")
        if self.refusal:
            return Answer(False, self.refusal)
        self.requests.append(request)
        return Answer(True, "", 7, 0.75)

    def stream_setpoint(self, setpoints_um: Mapping[str, float]) -> None:
        if self.stream_refusal:
            raise NotNowError(self.stream_refusal)
        self.setpoints.append(setpoints_um)

    @property
    def state(self) -> State:
        return State(self.next_states.pop(0) if self.next_states else self.state_then)

    @state.setter
    def state(self, state: str) -> None:
        self.state_then = state

    def status(self) -> Status:
        axis = AxisStatus(position_um=NAN, command_um=1.5, drive_v=20.0)
        return Status(
            state=self.state, mode="adaptive", faults=(), skipped_cycles=0, axes={"x": axis}
        )

    def health(self) -> Health:
        return Health(healthy=self.healthy, cycle_age_s=0.01)

    def faults(self) -> Faults:
        return Faults(faults=(Fault(id="S5", name="stuck", remedy="look"),))

    def fault_ids(self, mask: int) -> Sequence[str]:
        return [f"F{bit}" for bit in range(128) if mask >> bit & 1] + self.more_faults

    def realtime(self) -> Realtime:
        return Realtime()

    def metrics(self, *, lease_held: bool, openmetrics: bool) -> bytes:
        return f"lease {lease_held:d}\nopenmetrics {openmetrics:d}\n".encode()

    def config(self) -> Document:
        return self.configuration

    async def reload(self, peer: Peer) -> Reloaded:
        return Reloaded(changes=(f"by {peer.user}",))

    def open_reader(self) -> FakeReader:
        return self.reader

    async def params(self) -> Parameters:
        return Parameters(axes={}, sequence=3)

    async def params_history(self) -> History:
        return History(history=(HistoryEntry(3),))

    async def save_params(self, peer: Peer) -> Saved:  # noqa: ARG002 - a protocol
        return Saved(4)

    async def load_params(self, sequence: int | None, peer: Peer) -> Loaded:  # noqa: ARG002 - a protocol
        if sequence == 99:
            raise UnknownNameError("no parameters of number 99")
        return Loaded(sequence or 3)

    async def start_recording(
        self,
        label: str | None,
        peer: Peer,  # noqa: ARG002 - a protocol
        *,
        start_s: float | None = None,
        edge: RecordingEdge | None = None,
    ) -> Recording:
        self.recording_starts_s = start_s
        return Recording(True, f"20261121T120000Z-{label}", armed=edge is not None)

    async def stop_recording(self, peer: Peer) -> Recording:  # noqa: ARG002 - a protocol
        self.recordings_stopped += 1
        return Recording(False, "20261121T120000Z", records=5)

    async def recordings(self) -> Recordings:
        files = tuple(RecordingFile(path.stem) for path in self.recordings_folder.glob("*.h5"))
        return Recordings(
            running=self.running, recordings=files, folder=str(self.recordings_folder)
        )

    async def keep_recording(self, name: str, peer: Peer, *, kept: bool) -> KeptRecording:  # noqa: ARG002 - a protocol
        return KeptRecording(name, kept)

    def audit(self, entry: AuditEntry) -> None:
        self.audited.append(entry)

    async def played(self) -> Document:
        return {"number": 3, "position_um": [1.0, None]}

    async def scanned(self, first: int) -> Document:
        return {"number": 3, "first": first}

    async def audit_log(self, limit: int) -> Audit:
        newest = self.audited[::-1][:limit]
        return Audit(
            audit=tuple(AuditLine("", 0, "", "", each.what, each.accepted) for each in newest)
        )


class FakeRoles:
    """Every user has the role of `role`."""

    def __init__(self) -> None:
        self.role = Role.ENGINEER

    async def user(self, credentials: Credentials) -> User:  # noqa: ARG002 - a protocol
        return User("somebody", self.role)


class FakeNow:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class Served:
    """A service that runs in a thread, with its parts."""

    def __init__(self, folder: Path, limits: ConnectionLimits) -> None:
        self.stage, self.roles, self.now = FakeStage(folder), FakeRoles(), FakeNow()
        self.socket = folder / "api.sock"
        self.app = create_app(self.stage, self.roles, self.now)
        self.server = make_server(self.app, limits)

    def renew(self, folder: Path) -> None:
        """Use a new stage, and let time pass until all limits are reset."""
        self.stage, self.roles = FakeStage(folder), FakeRoles()
        self.now.now_s += 1000.0
        self.app.state.service = ServiceState(
            self.stage,
            self.roles,
            LeaseKeeper(self.now),
            set(),
            UrgentNotes(self.now),
            OpenStreams(),
            {},
        )

    @contextmanager
    def running(self) -> Iterator[None]:
        """Serve until the end of the block."""
        with bind(self.socket) as endpoint:
            thread = threading.Thread(
                target=lambda: asyncio.run(self.server.serve(sockets=[endpoint])), daemon=True
            )
            endpoint.listen()
            thread.start()
            try:
                yield
            finally:
                self.server.should_exit = True
                join(thread)
        os.unlink(self.socket)  # noqa: PTH108 - as the supervisor does

    @contextmanager
    def client(self, name: str = "test") -> Iterator[httpx.Client]:
        """Yield a client with its own connection."""
        transport = httpx.HTTPTransport(uds=str(self.socket), verify=NO_TLS)
        headers = {"x-piezod-client": name}
        with httpx.Client(
            transport=transport, base_url="http://piezod/v1/", headers=headers, timeout=20
        ) as client:
            yield client

    def called(self) -> int:
        """Return the number of requests that reached the stage."""
        return len(self.stage.requests)
