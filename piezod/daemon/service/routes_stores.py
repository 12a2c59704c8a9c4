"""Endpoints for what is kept: parameters, recordings and the configuration."""

from typing import Annotated, Final, TypeAlias

from fastapi import APIRouter
from fastapi import Request as HttpRequest
from pydantic import Field, StringConstraints

from piezod.config.fields import ConfigModel, Quantity
from piezod.daemon.service.answers import JsonAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.recording_files import RecordingAnswer, open_recording
from piezod.daemon.service.refusals import TooManyError
from piezod.daemon.service.request_context import VisitOf
from piezod.daemon.service.route_table import PREFIX, endpoint
from piezod.daemon.service.routes_commands import Nothing
from piezod.daemon.service.stage_service import NotNowError

router: Final = APIRouter(prefix=PREFIX, route_class=GuardedRoute)


# What may be part of the name of a recording.
Label: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]


class Restore(ConfigModel):
    """Which parameters to use."""

    sequence: Annotated[int, Quantity(1, 2**53)]


class StartRecording(ConfigModel):
    """What to call a recording; its name begins with the time in any case."""

    label: Label | None = Field(default=None, description="Becomes part of the name.")


@endpoint(router, "params")
async def params(visit: VisitOf) -> JsonAnswer:
    """Return the parameters in use."""
    return JsonAnswer(await visit.stage.params())


@endpoint(router, "params_history")
async def params_history(visit: VisitOf) -> JsonAnswer:
    """Return what is saved, newest first."""
    return JsonAnswer({"history": await visit.stage.params_history()})


@endpoint(router, "save_params")
async def save_params(_body: Nothing, visit: VisitOf) -> JsonAnswer:
    """Save the parameters in use."""
    saving = visit.perform("params save", lambda: visit.stage.save_params(visit.peer))
    return JsonAnswer(await saving)


@endpoint(router, "load_params")
async def load_params(_body: Nothing, visit: VisitOf) -> JsonAnswer:
    """Use the parameters that were saved last."""
    loading = visit.perform("params load", lambda: visit.stage.load_params(None, visit.peer))
    return JsonAnswer(await loading)


@endpoint(router, "restore_params")
async def restore_params(body: Restore, visit: VisitOf) -> JsonAnswer:
    """Use parameters that were saved earlier."""
    what = f"params restore {body.sequence}"
    loading = visit.perform(what, lambda: visit.stage.load_params(body.sequence, visit.peer))
    return JsonAnswer(await loading)


@endpoint(router, "reload")
async def reload(_body: Nothing, visit: VisitOf) -> JsonAnswer:
    """Read the configuration again; one that is not valid changes nothing."""
    return JsonAnswer(await visit.perform("reload", lambda: visit.stage.reload(visit.peer)))


@endpoint(router, "recordings")
async def recordings(visit: VisitOf) -> JsonAnswer:
    """Return the recording that is being made, and those that are finished."""
    running, finished = await visit.stage.recordings()
    return JsonAnswer({"running": running, "recordings": finished})


@endpoint(router, "start_recording")
async def start_recording(body: StartRecording, visit: VisitOf) -> JsonAnswer:
    """Start recording every cycle."""
    starting = visit.perform(
        f"recordings start {body.label or ''}".rstrip(),
        lambda: visit.stage.start_recording(body.label, visit.peer),
    )
    return JsonAnswer(await starting)


@endpoint(router, "stop_recording")
async def stop_recording(_body: Nothing, visit: VisitOf) -> JsonAnswer:
    """End the recording and close its file."""
    stopping = visit.perform("recordings stop", lambda: visit.stage.stop_recording(visit.peer))
    return JsonAnswer(await stopping)


@endpoint(router, "fetch_recording")
async def recording(name: str, request: HttpRequest, visit: VisitOf) -> RecordingAnswer:
    """Return the HDF5 file of a recording that is finished; one at a time for each user."""
    downloads, uid = visit.office.downloads, visit.peer.uid
    running, _ = await visit.stage.recordings()
    if running is not None and running["name"] == name:
        raise NotNowError(f"{name} is still being made", "stop the recording first")
    if uid in downloads:
        raise TooManyError("this user is getting a recording already", "wait until it is there")
    descriptor = open_recording(visit.stage.recordings_folder, name)
    return RecordingAnswer(descriptor, name, connection_of(request.scope), downloads, uid)
