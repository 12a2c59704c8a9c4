"""Endpoints that report the state of the stage and of the daemon."""

import asyncio
from dataclasses import replace
from functools import partial
from inspect import isawaitable
from typing import Annotated, Final

from fastapi import APIRouter, Query
from fastapi import Request as HttpRequest
from starlette.responses import Response

from piezod.daemon.service.answers import JsonAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.request_context import ContextOf
from piezod.daemon.service.route_table import PREFIX, endpoint
from piezod.daemon.service.telemetry_stream import TelemetryAnswer
from piezod.daemon.stage.errors import UnknownNameError
from piezod.messages.requests import TABLE

PLAIN_TEXT: Final = "text/plain; version=0.0.4"


class MetricsAnswer(Response):
    """Metrics as OpenMetrics, unless another media type is given."""

    media_type = "application/openmetrics-text; version=1.0.0; charset=utf-8"


router: Final = APIRouter(prefix=PREFIX, route_class=GuardedRoute)


@endpoint(router, "status")
async def status(context: ContextOf) -> JsonAnswer:
    """Return state, mode, faults, each axis in the newest cycle, the lease, and the user's role."""
    lease, role = context.state.lease.present, context.peer.role.name.lower()
    return JsonAnswer(replace(context.stage.status(), lease=lease, role=role))


@endpoint(router, "health")
async def health(context: ContextOf) -> JsonAnswer:
    """Return whether the loop runs cycles; HTTP status 503 if not."""
    health = context.stage.health()
    return JsonAnswer(health, 200 if health.healthy else TABLE["health"].also_fine)


_REPORTS: Final = (
    "faults",
    "realtime",
    "config",
    "played",
    "params",
    "params_history",
    "recordings",
)
"""Endpoints that return what the method of the stage with their name returns."""


def _add_report(name: str) -> None:
    async def report(context: ContextOf) -> JsonAnswer:
        found = getattr(context.stage, name)()
        return JsonAnswer(await found if isawaitable(found) else found)

    endpoint(router, name, name=name)(report)


for _name in _REPORTS:
    _add_report(_name)


@endpoint(router, "metrics", response_class=MetricsAnswer, status_code=200)
async def metrics(request: HttpRequest, context: ContextOf) -> MetricsAnswer:
    """Return the metrics; in the older text format if the client accepts only that one."""
    accepted = request.headers.get("accept", "")
    openmetrics = "text/plain" not in accepted or "openmetrics" in accepted
    held = context.state.lease.held
    # In a thread: the first time, the library is imported, and no other client should wait for it.
    make = partial(context.stage.metrics, lease_held=held, openmetrics=openmetrics)
    text = await asyncio.to_thread(make)
    return MetricsAnswer(text, media_type=None if openmetrics else PLAIN_TEXT)


@endpoint(router, "audit")
async def audit(
    context: ContextOf, limit: Annotated[int, Query(ge=1, le=1000)] = 100
) -> JsonAnswer:
    """Return the newest `limit` entries of the audit, newest first."""
    return JsonAnswer(await context.stage.audit_log(limit))


@endpoint(router, "openapi", responses=None)
async def openapi(request: HttpRequest) -> JsonAnswer:
    """Return the OpenAPI description."""
    return JsonAnswer(request.app.openapi())


@endpoint(router, "telemetry", response_class=TelemetryAnswer, status_code=200)
async def telemetry(
    request: HttpRequest,
    context: ContextOf,
    rate_hz: Annotated[float, Query(ge=1, le=50, allow_inf_nan=False)] = 10.0,
    axes: Annotated[str, Query(max_length=600, description="x,y; all axes if left out")] = "",
) -> TelemetryAnswer:
    """Return server-sent events: minimum, maximum and last value of each interval."""
    places = {name: place for place, name in enumerate(context.stage.axes)}
    wanted = axes.split(",") if axes else list(places)
    for name in wanted:
        if name not in places:
            raise UnknownNameError(f"no axis {name[:32]!r}", f"axes: {', '.join(places)}")
    chosen = {name: places[name] for name in wanted}
    records = context.stage.open_reader()
    connection = connection_of(request.scope)
    return TelemetryAnswer(records, context.stage.fault_ids, chosen, rate_hz, connection)
