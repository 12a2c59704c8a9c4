"""The application: the files of the page, its WebSocket, the API of the stages, the metrics."""

from collections.abc import Awaitable, Callable
from itertools import count
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from piezod.messages.answers import AXIS, STAGE
from piezod.messages.endpoints import Role
from piezod.web.access import METRICS, UPLOADS, Door, Secrets, role_of
from piezod.web.api import Api
from piezod.web.download import DownloadAnswer
from piezod.web.errors import PageError, require
from piezod.web.export import ExportAnswer, Exports
from piezod.web.metrics import PLAIN_TEXT, joined
from piezod.web.rows import encoded
from piezod.web.stages import Stages
from piezod.web.tab import Tab

MOST_TABS: Final = 32
_FILES: Final = Path(__file__).parent / "static"
_TRY_LATER: Final = 1013
_SCRIPT: Final = "text/javascript"
SHOWN_SCRIPT: Final = "".join(
    f"export const {kind} = {encoded({name: field.document for name, field in shown.items()})};\n"
    for kind, shown in (("AXIS", AXIS), ("STAGE", STAGE))
)
"""A script of the page: how fields of status and telemetry are shown."""


def _upload_to(stages: Stages) -> Callable[[Request], Awaitable[Response]]:
    """Return the answer to a file that a page sends for a stage."""

    async def upload(request: Request) -> Response:
        try:
            require(role_of(request.scope), Role.ENGINEER)
            stage = stages.named(request.path_params["stage"]).name
            name = request.headers.get("x-file-name", "")
            await stages.uploads.take(stage, name, request.stream())
        except (PageError, ClientDisconnect) as error:
            document = error.document if isinstance(error, PageError) else {}
            # What was not read yet is not waited for.
            return JSONResponse({"error": document}, 400, {"connection": "close"})
        return JSONResponse({})

    return upload


def create_app(stages: Stages, secrets: Secrets) -> Starlette:
    """Return the application."""
    numbers, exports = count(1), Exports(stages)

    async def index(_request: Request) -> Response:
        return FileResponse(_FILES / "index.html")

    async def socket(websocket: WebSocket) -> None:
        await websocket.accept()
        if stages.tabs >= MOST_TABS:
            await websocket.close(_TRY_LATER, f"{stages.tabs} tabs are open, close some")
            return
        name = f"{stages.client}:tab{next(numbers)}"
        await Tab(name, websocket, stages, role_of(websocket.scope)).run()

    async def recording(request: Request) -> Response:
        return DownloadAnswer(stages, request.path_params["stage"], request.path_params["name"])

    async def table(request: Request) -> Response:
        wanted = request.path_params
        return ExportAnswer(exports, wanted["stage"], wanted["name"], wanted["ending"])

    async def metrics(_request: Request) -> Response:
        return PlainTextResponse(joined(await stages.metrics()), media_type=PLAIN_TEXT)

    async def figure(request: Request) -> Response:
        image = stages.jobs.figure(request.path_params["stage"])
        return Response(
            image or b"", 200 if image else 404, {"cache-control": "no-store"}, "image/png"
        )

    async def shown(_request: Request) -> Response:
        return Response(SHOWN_SCRIPT, headers={"cache-control": "no-cache"}, media_type=_SCRIPT)

    api, methods = Api(stages).answer, ["GET", "POST", "DELETE"]
    return Starlette(
        routes=[
            Route("/v1/{path:path}", api, methods=methods),
            Route("/stages/{stage}/v1/{path:path}", api, methods=methods),
            Route("/", index),
            Route(METRICS, metrics),
            Route("/recordings/{stage}/{name}", recording),
            Route("/recordings/{stage}/{name}/{ending}", table),
            Route("/jobs/{stage}.png", figure),
            Route(UPLOADS + "{stage}", _upload_to(stages), methods=["POST"]),
            WebSocketRoute("/ws", socket),
            Route("/static/shown.js", shown),
            Mount("/static", StaticFiles(directory=_FILES)),
        ],
        middleware=[Middleware(Door, secrets=secrets)],
    )
