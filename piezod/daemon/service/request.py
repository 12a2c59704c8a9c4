"""One request of one client: its access rights, the audit, and the streams that it ends."""

from collections.abc import Awaitable, Callable, Iterable, Sequence
from contextlib import nullcontext
from typing import Annotated, Any, Final, NamedTuple, TypeVar

from fastapi import Depends
from fastapi import Request as HttpRequest

from piezod.config.states import State
from piezod.control.stage.answer import Answer
from piezod.daemon.service.access import LeaseKeeper, Roles, UrgentNotes
from piezod.daemon.service.answers import SupersededError
from piezod.daemon.stage.errors import BadValueError, NotNowError, StageError
from piezod.daemon.stage.peer import AuditEntry, Peer
from piezod.daemon.stage.running_stage import RunningStage
from piezod.messages.endpoints import Access, Group
from piezod.messages.requests import TABLE, Path, Request


class OpenStream:
    """A stream in progress, until another request commands one of its axes."""

    def __init__(self, axes: Iterable[str]) -> None:
        self.axes = frozenset(axes)
        self.superseded = ""
        """What took over, for people; empty while the stream has all its axes."""

    def check(self) -> None:
        """Check that the stage still follows this stream.

        Raises:
            SupersededError: If another request has taken over.
        """
        if self.superseded:
            raise SupersededError(self.superseded, "start a new stream for further setpoints")


class OpenStreams:
    """All streams in progress; the newest request for an axis ends the stream of that axis."""

    def __init__(self) -> None:
        self._streams: set[OpenStream] = set()

    def open(self, axes: Iterable[str]) -> OpenStream:
        """Add a stream whose request the loop has accepted."""
        stream = OpenStream(axes)
        self._streams.add(stream)
        return stream

    def close(self, stream: OpenStream) -> None:
        """Remove a stream that has ended; a second call does nothing."""
        self._streams.discard(stream)

    def supersede(self, axes: Iterable[str], by: str) -> None:
        """End the streams of these axes.

        Args:
            axes: Names of the axes.
            by: The request that commands them from now on, and its user, for people.
        """
        for stream in self._streams:
            if shared := sorted(stream.axes.intersection(axes)):
                stream.superseded = f"{by} has taken over {', '.join(shared)}"
        self._streams = {stream for stream in self._streams if not stream.superseded}


def commanded_axes(request: Request, all_axes: Sequence[str]) -> Sequence[str]:
    """Return the axes that no longer follow their stream when a request was accepted."""
    row = TABLE[request.kind]
    if row.group is not Group.MOVE and not row.access.urgent:
        return ()
    named = getattr(request, "axes", None) or getattr(request, "command_um", None)
    axis = getattr(request, "axis", None)
    if isinstance(request, Path):
        named = dict.fromkeys(name for point in request.points for name in point)
    return tuple(named or ((axis,) if axis else all_axes))


ResultT = TypeVar("ResultT")
_SHOWN: Final = 300
_STOPPED: Final = frozenset({State.BLIND, State.FAULT})
"""States in which faults are the reason why a request is refused."""


class ServiceState(NamedTuple):
    """The state that all requests share."""

    stage: RunningStage  #: The stage.
    roles: Roles  #: Gives the role of each user.
    lease: LeaseKeeper  #: The lease of the stage.
    downloads: set[int]  #: Users with a download in progress.
    urgent_notes: UrgentNotes  #: Limits the audit entries of urgent requests.
    streams: OpenStreams  #: The setpoint streams in progress.
    #: Process and client that started the newest recording, by its name. The clients of `piezod
    #: web` are one process.
    recorders: dict[str, tuple[int, str]]


class RequestContext(NamedTuple):
    """An admitted request."""

    state: ServiceState  #: The state that it shares with other requests.
    peer: Peer  #: The client that sent it.
    access: Access  #: What its endpoint requires and allows.

    @property
    def stage(self) -> RunningStage:
        """The stage."""
        return self.state.stage

    def claim(self) -> None:
        """Take or renew the lease, if the endpoint needs it.

        Raises:
            LeaseHeldError: If another client has it.
        """
        if self.access.lease:
            self.state.lease.claim(self.peer)

    async def perform(self, what: str, action: Callable[[], Awaitable[ResultT]]) -> ResultT:
        """Carry out an action under the lease, if the endpoint needs it, and note it.

        Args:
            what: The request, for the audit.
            action: The action.

        Raises:
            StageError: If it fails.
        """
        try:
            with self.state.lease.claimed(self.peer) if self.access.lease else nullcontext():
                result = await action()
        except StageError as error:
            self.note(what, error.what)
            raise
        self.note(what)
        return result

    async def ask(self, request: Request) -> Answer:
        """Send a request to the loop and return the answer.

        Raises:
            StageError: If the loop does not carry it out.
        """

        async def accepted() -> Answer:
            answer = await self.stage.request(request, self.peer)
            if answer.out_of_range:
                raise BadValueError(answer.why, "send a value within the range")
            if not answer.accepted:
                raise NotNowError(answer.why, self._remedy())
            axes = commanded_axes(request, self.stage.axes)
            self.state.streams.supersede(axes, f"{request.kind} of {self.peer.user}")
            return answer

        return await self.perform(describe(request), accepted)

    def _remedy(self) -> str:
        """Return the remedy of a refused request: that of the faults which stop the stage."""
        if self.stage.state in _STOPPED and (faults := self.stage.faults().faults):
            return "; ".join(f"{each.id}, {each.name}: {each.remedy}" for each in faults)
        return "`piezod status` shows the state and the faults"

    def note(self, what: str, why: str = "") -> None:
        """Write the request to the audit; `why` is empty if it was carried out."""
        entry = AuditEntry(self.peer, what, not why, why)
        if not self.access.urgent:  # the rate limit covers all other requests
            self.stage.audit(entry)
        elif limited := self.state.urgent_notes.limit(entry):
            self.stage.audit(limited)


def describe(request: Request) -> str:
    """Return a request as one line of limited length, for the audit."""
    fields = request.model_dump(exclude={"kind"}, exclude_defaults=True, mode="json")
    text = f"{request.kind} {fields}" if fields else request.kind
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


# A coroutine, because FastAPI would call a function in a thread, for each request.
async def _context(request: HttpRequest) -> Any:
    return request.state.context


ContextOf = Annotated[RequestContext, Depends(_context)]
"""Type of the parameter by which an endpoint gets its context."""
