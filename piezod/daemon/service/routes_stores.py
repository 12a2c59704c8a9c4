"""Endpoints of parameters, recordings and the configuration."""

import asyncio
from typing import Annotated, Final, TypeAlias

from fastapi import APIRouter
from fastapi import Request as HttpRequest
from pydantic import Field, StringConstraints

from piezod.config.fields import ConfigModel, Quantity
from piezod.config.quantities import StartS
from piezod.daemon.service.answers import JsonAnswer
from piezod.daemon.service.guarded_route import GuardedRoute
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.recording_files import RecordingAnswer, open_recording
from piezod.daemon.service.refusals import TooManyError
from piezod.daemon.service.request_context import ContextOf
from piezod.daemon.service.route_table import PREFIX, endpoint
from piezod.daemon.service.routes_commands import Nothing
from piezod.daemon.stage.errors import NotNowError
from piezod.messages.requests import TABLE

router: Final = APIRouter(prefix=PREFIX, route_class=GuardedRoute)


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
        lambda: context.stage.start_recording(body.label, context.peer, start_s=body.start_s),
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
