"""Endpoints that tell how things are."""

from typing import Annotated, Final

from fastapi import APIRouter, Query
from fastapi import Request as HttpRequest

from piezod.daemon.service.answers import JsonAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.request_context import VisitOf
from piezod.daemon.service.route_table import PREFIX, endpoint
from piezod.daemon.service.stage_service import UnknownNameError
from piezod.daemon.service.telemetry_stream import TelemetryAnswer

router: Final = APIRouter(prefix=PREFIX, route_class=GuardedRoute)


@endpoint(router, "status")
async def status(visit: VisitOf) -> JsonAnswer:
    """Return state, mode, faults, and each axis in the newest cycle."""
    return JsonAnswer(visit.stage.status())


@endpoint(router, "health")
async def health(visit: VisitOf) -> JsonAnswer:
    """Return whether the loop runs on schedule; with status 503 where it does not."""
    healthy, document = visit.stage.health()
    return JsonAnswer({"healthy": healthy, **document}, 200 if healthy else 503)


@endpoint(router, "faults")
async def faults(visit: VisitOf) -> JsonAnswer:
    """Return what is present or latched, and what to do about it."""
    return JsonAnswer({"faults": visit.stage.faults()})


@endpoint(router, "realtime")
async def realtime(visit: VisitOf) -> JsonAnswer:
    """Return what the loop asked of the operating system, and what it obtained."""
    return JsonAnswer(visit.stage.realtime())


@endpoint(router, "config")
async def config(visit: VisitOf) -> JsonAnswer:
    """Return the configuration in force."""
    return JsonAnswer(visit.stage.config())


@endpoint(router, "audit")
async def audit(visit: VisitOf, limit: Annotated[int, Query(ge=1, le=1000)] = 100) -> JsonAnswer:
    """Return who asked for what, newest first."""
    return JsonAnswer({"audit": await visit.stage.audit_log(limit)})


@endpoint(router, "openapi", responses=None)
async def openapi(request: HttpRequest) -> JsonAnswer:
    """Return this description."""
    return JsonAnswer(request.app.openapi())


@endpoint(router, "telemetry")
async def telemetry(
    request: HttpRequest,
    visit: VisitOf,
    rate_hz: Annotated[float, Query(ge=1, le=50, allow_inf_nan=False)] = 10.0,
    axes: Annotated[str, Query(max_length=600, description="x,y; left out: all")] = "",
) -> TelemetryAnswer:
    """Return server-sent events: least, largest and last value in each interval."""
    places = {name: place for place, name in enumerate(visit.stage.axes)}
    wanted = axes.split(",") if axes else list(places)
    for name in wanted:
        if name not in places:
            raise UnknownNameError(f"no axis {name[:32]!r}", f"axes: {', '.join(places)}")
    chosen = {name: places[name] for name in wanted}
    return TelemetryAnswer(visit.stage, chosen, rate_hz, connection_of(request.scope))
