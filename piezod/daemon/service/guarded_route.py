"""The way of every request to its endpoint: role, then body; both before FastAPI sees it."""

import asyncio
import re
from collections.abc import Callable, Coroutine
from typing import Any, Final, NoReturn

from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from piezod.config.endpoints import SMALL_BODY, Access
from piezod.daemon.logging import logger
from piezod.daemon.service.answers import mistake_answer
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.refusals import (
    BadRequestError,
    ForbiddenError,
    MediaTypeError,
    TooLargeError,
)
from piezod.daemon.service.request_context import RequestContext, RequestQueue
from piezod.daemon.service.route_table import ROUTES
from piezod.daemon.service.stage_service import BadValueError, Peer, StageError
from piezod.daemon.service.strict_json import loads

_LOG: Final = logger("service")
_CLIENT: Final = re.compile(r"[A-Za-z0-9_.:@-]{0,64}")
_JSON_TYPE: Final = (b"content-type", b"application/json")


class GuardedRoute(APIRoute):
    """An endpoint of the table of commands."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Put role and body before what FastAPI does."""
        handler = super().get_route_handler()
        method = "".join(self.methods or ())  # they have one each
        row = ROUTES[method, self.path]
        access, reads_body = row.access, method == "POST" and not row.streamed
        model = self.body_field.field_info.annotation if self.body_field else None

        async def guarded(request: Request) -> Response:
            request.state.visit = await _let_in(request, access)
            try:
                if reads_body:
                    request = await _with_body(request, access.most_bytes, model)
                return await handler(request)
            except ClientDisconnect:
                return Response(status_code=400)  # nobody is there to read it
            except (StageError, RequestValidationError, HTTPException):
                raise
            except Exception as error:  # noqa: BLE001 - whatever it is, the client gets an answer
                # Left to Starlette, it would also cost the connection.
                _LOG.exception("mistake in an endpoint", endpoint=f"{method} {self.path}")
                return mistake_answer(error)

        return guarded


class _StrictRequest(Request):
    """A request whose body has been read strictly already, and validated if it is long."""

    def __init__(self, request: Request, body: bytes, document: Any) -> None:
        scope = request.scope
        if not body:  # the same as an empty object
            scope = {**scope, "headers": [*scope["headers"], _JSON_TYPE]}
        super().__init__(scope, request.receive)
        self._body, self._document = body or b"{}", document

    async def json(self) -> Any:
        """Return the document, or the model of which it is one."""
        return self._document


async def _let_in(request: Request, access: Access) -> RequestContext:
    office: RequestQueue = request.app.state.office
    peer = await _peer(request, office)
    visit = RequestContext(office, peer, access)
    if peer.role < access.role:
        needed = access.role.name.lower()
        what = f"{peer.user} is {peer.role.name.lower()} here, this needs {needed}"
        if request.method != "GET":
            visit.note(f"{request.method} {request.url.path}", what)
        raise ForbiddenError(what, "become a member of the group piezod or piezod-eng")
    return visit


async def _peer(request: Request, office: RequestQueue) -> Peer:
    client = request.headers.get("x-piezod-client", "")
    if not _CLIENT.fullmatch(client):
        what = "header X-Piezod-Client: allowed are up to 64 letters, digits and _.:@-"
        raise BadRequestError(what)
    credentials = connection_of(request.scope).credentials
    user = await office.roles.user(credentials)
    return Peer(credentials.uid, credentials.pid, user.name, client, user.role)


async def _with_body(request: Request, most_bytes: int, model: Any) -> _StrictRequest:
    body = await _body(request, most_bytes)
    if not body:
        return _StrictRequest(request, b"", {})
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise MediaTypeError(f"content-type {kind[:40]!r}, allowed: application/json")
    if len(body) <= SMALL_BODY:
        return _StrictRequest(request, body, _read(body))
    # The loop sees a supervisor whose event loop is busy for too long as one that is gone.
    reading: asyncio.Semaphore = request.app.state.reading
    async with reading:
        document = await asyncio.to_thread(_read_and_validate, body, model)
    return _StrictRequest(request, body, document)


async def _body(request: Request, most_bytes: int) -> bytes:
    if int(request.headers.get("content-length", "0")) > most_bytes:
        _too_large(most_bytes)
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > most_bytes:
            _too_large(most_bytes)
    return bytes(body)


def _read(body: bytes) -> Any:
    document = loads(body)
    _refuse_files(document)
    return document


def _read_and_validate(body: bytes, model: type[BaseModel]) -> BaseModel:
    """Do what FastAPI would; it takes a model for a document of it that is valid."""
    try:
        return model.model_validate(_read(body))
    except ValidationError as error:
        found = error.errors(include_url=False)
        problems = [{**each, "loc": ("body", *each["loc"])} for each in found]
        raise RequestValidationError(problems) from error


def _refuse_files(document: Any) -> None:
    """Refuse waveforms from files: validation would read whatever file a client names."""
    if isinstance(document, dict):
        if document.get("kind") == "csv":
            what = "kind: csv is not allowed here, the daemon reads no files of clients"
            raise BadValueError(what, "send the values, as a waveform of kind points")
        document = tuple(document.values())
    if isinstance(document, tuple):
        for entry in document:
            _refuse_files(entry)


def _too_large(most_bytes: int) -> NoReturn:
    raise TooLargeError(f"the body is too long, allowed here: at most {most_bytes} bytes")
