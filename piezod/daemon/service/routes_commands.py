"""Endpoints of the requests, of the setpoint stream and of the lease.

The body of a request endpoint is the request without its kind.
"""

from typing import Any, Final

from fastapi import APIRouter
from fastapi import Request as HttpRequest

from piezod.config.fields import ConfigModel
from piezod.daemon.service.answers import JsonAnswer
from piezod.daemon.service.client_session import SessionAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.refusals import ForbiddenError
from piezod.daemon.service.request_context import ContextOf, RequestContext, describe
from piezod.daemon.service.route_table import PREFIX, endpoint
from piezod.daemon.service.setpoint_stream import SetpointStream
from piezod.messages.answers import Answer as Accepted
from piezod.messages.answers import Released
from piezod.messages.endpoints import Endpoint, Role
from piezod.messages.requests import TABLE, Request, Reset

router: Final = APIRouter(prefix=PREFIX, route_class=GuardedRoute)


class Nothing(ConfigModel):
    """An empty object; an empty body means the same."""


def _add_command(row: Endpoint) -> None:
    async def command_endpoint(command: Any, context: ContextOf) -> JsonAnswer:
        answer = await context.ask(_allowed(command, context))
        motion, duration_s = answer.motion, answer.duration_s
        return JsonAnswer(Accepted(motion=motion, duration_s=duration_s, state=context.stage.state))

    command_endpoint.__annotations__["command"] = row.request
    endpoint(router, row.name, name=row.path)(command_endpoint)


def _allowed(command: Request, context: RequestContext) -> Request:
    for_engineers = isinstance(command, Reset) and command.engineer
    if for_engineers and context.peer.role < Role.ENGINEER:
        what = "only an engineer may use `--engineer`"
        context.note(describe(command), what)
        raise ForbiddenError(what, "become a member of the group piezod-eng")
    return command


for _row in TABLE.values():
    if _row.request is not None:
        _add_command(_row)


_LINES: Final = {
    "requestBody": {
        "required": False,
        "description": 'Lines of JSON such as {"x": 12.5}: a position in µm for each axis.',
        "content": {"application/x-ndjson": {"schema": {"type": "string"}}},
    }
}


@endpoint(router, "stream", openapi_extra=_LINES)
async def stream(request: HttpRequest, context: ContextOf) -> JsonAnswer:
    """Follow the setpoints of the body until it ends."""
    stream = SetpointStream(context, connection_of(request.scope))
    return JsonAnswer(await stream.run(request))


@endpoint(router, "session")
async def session(_body: Nothing, request: HttpRequest, context: ContextOf) -> SessionAnswer:
    """Take the lease until the connection closes; then stop the stage."""
    return SessionAnswer(context, connection_of(request.scope))


@endpoint(router, "renew_lease")
async def renew_lease(_body: Nothing, context: ContextOf) -> JsonAnswer:
    """Take or renew the lease."""
    return JsonAnswer(context.state.lease.claim(context.peer))


@endpoint(router, "release_lease")
async def release_lease(context: ContextOf) -> JsonAnswer:
    """Release the lease."""
    return JsonAnswer(Released(released=context.state.lease.release(context.peer)))
