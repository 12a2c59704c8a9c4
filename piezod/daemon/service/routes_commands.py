"""Endpoints that the loop carries out, and the lease; each body is a request without its kind."""

from typing import Any, Final

from fastapi import APIRouter
from fastapi import Request as HttpRequest
from pydantic import BaseModel

from piezod.config import requests
from piezod.config.fields import ConfigModel
from piezod.config.requests import Request
from piezod.daemon.service.answers import ErrorDocument, JsonAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.refusals import ForbiddenError
from piezod.daemon.service.request_context import RequestContext, VisitOf, describe
from piezod.daemon.service.setpoint_stream import SetpointStream
from piezod.daemon.service.stage_service import Role

router: Final = APIRouter(prefix="/v1", route_class=GuardedRoute)

COMMANDS: Final[dict[str, type[BaseModel]]] = {
    "arm": requests.Arm,
    "disarm": requests.Disarm,
    "mode": requests.SelectMode,
    "goto": requests.Goto,
    "wave": requests.Wave,
    "follow": requests.Follow,
    "hold": requests.Hold,
    "resume": requests.Resume,
    "condition": requests.Condition,
    "zero": requests.Zero,
    "stop": requests.Stop,
    "estop": requests.Estop,
    "reset": requests.Reset,
    "identify": requests.Identify,
    "model": requests.AdoptModel,
    "shutdown": requests.Shutdown,
}
"""Path, and what its body is."""
ERRORS: Final[dict[int | str, dict[str, Any]]] = {"default": {"model": ErrorDocument}}


class Accepted(BaseModel):
    """A request is being carried out; `motion` numbers the movement that it began, else 0."""

    accepted: bool = True
    motion: int


class Nothing(ConfigModel):
    """An empty object; an empty body is the same."""


def _add_command(path: str, model: type[BaseModel]) -> None:
    async def endpoint(command: Any, visit: VisitOf) -> JsonAnswer:
        answer = await visit.ask(_allowed(command, visit))
        return JsonAnswer({"accepted": True, "motion": answer.motion})

    endpoint.__annotations__["command"] = model
    router.add_api_route(
        f"/{path}",
        endpoint,
        methods=["POST"],
        name=path,
        description=model.__doc__,
        response_class=JsonAnswer,
        response_model=None,
        responses={200: {"model": Accepted}, **ERRORS},
    )


def _allowed(command: Request, visit: RequestContext) -> Request:
    for_engineers = isinstance(command, requests.Reset) and command.engineer
    if for_engineers and visit.peer.role < Role.ENGINEER:
        what = "only an engineer resets latches of level 3"
        visit.note(describe(command), what)
        raise ForbiddenError(what, "become a member of the group piezod-eng")
    return command


for _path, _model in COMMANDS.items():
    _add_command(_path, _model)


@router.post("/stream", responses={200: {"model": Accepted}, **ERRORS}, response_model=None)
async def stream(request: HttpRequest, visit: VisitOf) -> JsonAnswer:
    """Follow setpoints in µm, a line `{"x": 12.5}` for each, for as long as the body goes on."""
    following = SetpointStream(visit, connection_of(request.scope)).follow(request)
    return JsonAnswer(await following)


@router.post("/lease", responses=ERRORS, response_model=None)
async def renew_lease(_body: Nothing, visit: VisitOf) -> JsonAnswer:
    """Take the lease or renew it, for 30 s; every command that needs it does the same."""
    return JsonAnswer(visit.office.lease.claim(visit.peer))


@router.delete("/lease", responses=ERRORS, response_model=None)
async def release_lease(visit: VisitOf) -> JsonAnswer:
    """Give the lease back, so that others need not wait."""
    return JsonAnswer({"released": visit.office.lease.release(visit.peer)})
