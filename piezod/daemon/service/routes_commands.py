"""Endpoints that the loop carries out, and the lease; each body is a request without its kind."""

from typing import Any, Final

from fastapi import APIRouter
from fastapi import Request as HttpRequest
from pydantic import BaseModel

from piezod.config.endpoints import Endpoint, Role
from piezod.config.fields import ConfigModel
from piezod.config.requests import TABLE, Request, Reset
from piezod.daemon.service.answers import JsonAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.refusals import ForbiddenError
from piezod.daemon.service.request_context import RequestContext, VisitOf, describe
from piezod.daemon.service.route_table import ERRORS, PREFIX, endpoint
from piezod.daemon.service.setpoint_stream import SetpointStream

router: Final = APIRouter(prefix=PREFIX, route_class=GuardedRoute)


class Accepted(BaseModel):
    """A request is being carried out; `motion` numbers the movement that it began, else 0."""

    accepted: bool = True
    motion: int


class Nothing(ConfigModel):
    """An empty object; an empty body is the same."""


def _add_command(row: Endpoint) -> None:
    async def command_endpoint(command: Any, visit: VisitOf) -> JsonAnswer:
        answer = await visit.ask(_allowed(command, visit))
        return JsonAnswer({"accepted": True, "motion": answer.motion})

    command_endpoint.__annotations__["command"] = row.request
    responses = {200: {"model": Accepted}, **ERRORS}
    options = {"response_class": JsonAnswer, "responses": responses}
    endpoint(router, row.name, name=row.path, **options)(command_endpoint)


def _allowed(command: Request, visit: RequestContext) -> Request:
    for_engineers = isinstance(command, Reset) and command.engineer
    if for_engineers and visit.peer.role < Role.ENGINEER:
        what = "only an engineer resets latches of level 3"
        visit.note(describe(command), what)
        raise ForbiddenError(what, "become a member of the group piezod-eng")
    return command


for _row in TABLE.values():
    if _row.request is not None:
        _add_command(_row)


@endpoint(router, "stream", responses={200: {"model": Accepted}, **ERRORS})
async def stream(request: HttpRequest, visit: VisitOf) -> JsonAnswer:
    """Follow setpoints in µm, a line `{"x": 12.5}` for each, for as long as the body goes on."""
    stream = SetpointStream(visit, connection_of(request.scope))
    return JsonAnswer(await stream.run(request))


@endpoint(router, "renew_lease")
async def renew_lease(_body: Nothing, visit: VisitOf) -> JsonAnswer:
    """Take the lease or renew it, for 30 s; every command that needs it does the same."""
    return JsonAnswer(visit.office.lease.claim(visit.peer))


@endpoint(router, "release_lease")
async def release_lease(visit: VisitOf) -> JsonAnswer:
    """Give the lease back, so that others need not wait."""
    return JsonAnswer({"released": visit.office.lease.release(visit.peer)})
