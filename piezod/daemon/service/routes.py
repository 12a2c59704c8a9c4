"""All endpoints: requests to the loop, reports, parameters and recordings.

The body of a request endpoint is the request without its kind.
"""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from inspect import isawaitable
from typing import Annotated, Any, Final, TypeAlias

from fastapi import APIRouter, Query
from fastapi import Request as HttpRequest
from pydantic import Field, StringConstraints
from starlette.responses import Response

from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.config.quantities import StartS
from piezod.daemon.service.answers import ForbiddenError, JsonAnswer, TooManyError
from piezod.daemon.service.connection import connection_of
from piezod.daemon.service.long_answers import (
    RecordingAnswer,
    SessionAnswer,
    TelemetryAnswer,
    open_recording,
)
from piezod.daemon.service.request import ContextOf, RequestContext, describe
from piezod.daemon.service.route import PREFIX, GuardedRoute, endpoint
from piezod.daemon.service.setpoint_stream import SetpointStream
from piezod.daemon.stage.errors import NotNowError, UnknownNameError
from piezod.messages.answers import Answer as Accepted
from piezod.messages.answers import Released
from piezod.messages.endpoints import Endpoint, Role
from piezod.messages.recording_edge import RecordingEdge
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


PLAIN_TEXT: Final = "text/plain; version=0.0.4"


class MetricsAnswer(Response):
    """Metrics as OpenMetrics, unless another media type is given."""

    media_type = "application/openmetrics-text; version=1.0.0; charset=utf-8"


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


@endpoint(router, "scanned")
async def scanned(
    context: ContextOf, first: Annotated[int, Query(ge=0, le=1_000_000)] = 0
) -> JsonAnswer:
    """Return the last scan: its state, and the samples of some sweeps from `first` on."""
    return JsonAnswer(await context.stage.scanned(first))


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
    places = context.stage.places
    wanted = axes.split(",") if axes else list(places)
    for name in wanted:
        if name not in places:
            raise UnknownNameError(f"no axis {name[:32]!r}", f"axes: {', '.join(places)}")
    chosen = {name: places[name] for name in wanted}
    records = context.stage.open_reader()
    connection = connection_of(request.scope)
    return TelemetryAnswer(records, context.stage.fault_ids, chosen, rate_hz, connection)


# The label becomes part of a file name.
Label: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]

RecordingName: TypeAlias = Annotated[
    str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,99}$")
]


class Restore(ConfigModel):
    """The number of saved parameters."""

    sequence: Annotated[int, Quantity(1, 2**53)]


class StartRecording(ConfigModel):
    """The label of a recording, whose name always begins with the time, and its start."""

    label: Label | None = Field(default=None, description="Becomes part of the name.")
    start_s: StartS = None
    edge: RecordingEdge | None = Field(
        default=None, description="The edge that starts it, in place of start_s."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.edge is not None and self.start_s is not None:
            yield ("start_s",), "an edge starts the recording: leave out one of the two"


class KeepRecording(ConfigModel):
    """A recording, and whether the limit of their size spares it."""

    name: RecordingName = Field(description="Name in the list of recordings.")
    kept: bool = Field(default=True, description="Whether it is marked as kept.")


def _add_action(name: str) -> None:
    what = TABLE[name].path.replace("/", " ")

    async def action(_body: Nothing, context: ContextOf) -> JsonAnswer:
        act = getattr(context.stage, name)
        return JsonAnswer(await context.perform(what, lambda: act(context.peer)))

    endpoint(router, name, name=name)(action)


for _name in ("save_params", "reload", "stop_recording"):  # the method of the stage does all
    _add_action(_name)


@endpoint(router, "load_params")
async def load_params(_body: Nothing, context: ContextOf) -> JsonAnswer:
    """Use the parameters that were saved last."""
    loading = context.perform("params load", lambda: context.stage.load_params(None, context.peer))
    return JsonAnswer(await loading)


@endpoint(router, "restore_params")
async def restore_params(body: Restore, context: ContextOf) -> JsonAnswer:
    """Use parameters that were saved earlier."""
    what = f"params restore {body.sequence}"
    loading = context.perform(what, lambda: context.stage.load_params(body.sequence, context.peer))
    return JsonAnswer(await loading)


@endpoint(router, "start_recording")
async def start_recording(body: StartRecording, context: ContextOf) -> JsonAnswer:
    """Start recording every cycle."""
    started = await context.perform(
        f"recordings start {body.label or ''}".rstrip(),
        lambda: context.stage.start_recording(
            body.label, context.peer, start_s=body.start_s, edge=body.edge
        ),
    )
    recorders = context.state.recorders
    recorders.clear()  # there is one recording at a time
    recorders[started.name] = context.peer.pid, context.peer.client
    return JsonAnswer(started)


@endpoint(router, "keep_recording")
async def keep_recording(body: KeepRecording, context: ContextOf) -> JsonAnswer:
    """Mark a recording as kept, or remove the mark."""
    keeping = context.perform(
        f"recordings {'keep' if body.kept else 'unkeep'} {body.name}",
        lambda: context.stage.keep_recording(body.name, context.peer, kept=body.kept),
    )
    return JsonAnswer(await keeping)


@endpoint(router, "fetch_recording", response_class=RecordingAnswer, status_code=200)
async def recording(name: str, request: HttpRequest, context: ContextOf) -> RecordingAnswer:
    """Return the HDF5 file of a finished recording; one download at a time for each user."""
    downloads, uid = context.state.downloads, context.peer.uid
    running = (await context.stage.recordings()).running
    if running is not None and running.file == name:
        raise NotNowError(f"{name} is still in progress", "stop the recording first")
    if uid in downloads:
        raise TooManyError("this user already downloads a recording", "wait for its end")
    descriptor = await asyncio.to_thread(open_recording, context.stage.recordings_folder, name)
    return RecordingAnswer(descriptor, name, connection_of(request.scope), downloads, uid)
