"""One request of one client, on its way through role, body, lease and audit."""

from collections.abc import Awaitable, Callable
from typing import Annotated, Any, Final, NamedTuple, TypeVar

from fastapi import Depends
from fastapi import Request as HttpRequest

from piezod.config.endpoints import Access
from piezod.config.requests import Request
from piezod.control.stage.record import Answer
from piezod.daemon.service.lease import Lease
from piezod.daemon.service.roles import Roles
from piezod.daemon.service.stage_service import (
    AuditEntry,
    NotNowError,
    Peer,
    StageError,
    StageService,
)
from piezod.daemon.service.urgent_notes import UrgentNotes

ResultT = TypeVar("ResultT")
_SHOWN: Final = 300


class RequestQueue(NamedTuple):
    """What all requests share.

    Attributes:
        stage: The stage.
        roles: Who is who.
        lease: Who moves the stage.
        downloads: Users who are getting a recording.
        urgent_notes: Limits what is noted of urgent requests.
    """

    stage: StageService
    roles: Roles
    lease: Lease
    downloads: set[int]
    urgent_notes: UrgentNotes


class RequestContext(NamedTuple):
    """A request that was let in.

    Attributes:
        office: What it shares with others.
        peer: Who asks.
        access: What the endpoint asks of him.
    """

    office: RequestQueue
    peer: Peer
    access: Access

    @property
    def stage(self) -> StageService:
        """The stage."""
        return self.office.stage

    def claim(self) -> None:
        """Take or renew the lease, where the endpoint needs it.

        Raises:
            LeaseHeldError: If another has it.
        """
        if self.access.lease:
            self.office.lease.claim(self.peer)

    async def perform(self, what: str, action: Callable[[], Awaitable[ResultT]]) -> ResultT:
        """Do something under the lease where one is needed, and note it.

        Args:
            what: The request, for the audit.
            action: What does it.

        Raises:
            StageError: If it cannot be done.
        """
        try:
            self.claim()
            result = await action()
        except StageError as error:
            self.note(what, error.what)
            raise
        self.note(what)
        return result

    async def ask(self, request: Request) -> Answer:
        """Have the loop carry out a request.

        Raises:
            StageError: If it is not carried out.
        """

        async def accepted() -> Answer:
            answer = await self.stage.request(request, self.peer)
            if not answer.accepted:
                raise NotNowError(answer.why, "`piezod status` shows the state and the faults")
            return answer

        return await self.perform(describe(request), accepted)

    def note(self, what: str, why: str = "") -> None:
        """Note what was asked for, and why it was not done where it was not."""
        entry = AuditEntry(self.peer, what, not why, why)
        if not self.access.urgent:  # others are limited as requests
            self.stage.audit(entry)
        elif limited := self.office.urgent_notes.limit(entry):
            self.stage.audit(limited)


def describe(request: Request) -> str:
    """Describe a request for the audit, in a line of limited length."""
    fields = request.model_dump(exclude={"kind"}, exclude_defaults=True, mode="json")
    text = f"{request.kind} {fields}" if fields else request.kind
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _visit(request: HttpRequest) -> Any:
    return request.state.visit


VisitOf = Annotated[RequestContext, Depends(_visit)]
"""What an endpoint declares to get its visit."""
