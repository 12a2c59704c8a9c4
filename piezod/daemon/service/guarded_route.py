"""The checks of every request before FastAPI: first the role, then the body."""

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

from piezod.daemon.logging import logger
from piezod.daemon.service.answers import internal_error_answer
from piezod.daemon.service.peer_protocol import connection_of
from piezod.daemon.service.refusals import (
    BadRequestError,
    ForbiddenError,
    MediaTypeError,
    TooLargeError,
)
from piezod.daemon.service.request_context import RequestContext, ServiceState
from piezod.daemon.service.route_table import ROUTES
from piezod.daemon.service.strict_json import loads
from piezod.daemon.stage.errors import BadValueError, StageError
from piezod.daemon.stage.peer import Peer
from piezod.messages.endpoints import SMALL_BODY, Access

_LOG: Final = logger("service")
_CLIENT: Final = re.compile(r"[A-Za-z0-9_.:@-]{0,64}")
_JSON_TYPE: Final = (b"content-type", b"application/json")


class GuardedRoute(APIRoute):
    """An endpoint of the table of commands."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return a handler that checks role and body, then calls the one of FastAPI."""
        handler = super().get_route_handler()
        method = "".join(self.methods or ())  # each route has one
        row = ROUTES[method, self.path]
        access, reads_body = row.access, method == "POST" and not row.streamed
        model = self.body_field.field_info.annotation if self.body_field else None

        async def guarded(request: Request) -> Response:
            request.state.context = await _admitted(request, access)
            try:
                if reads_body:
                    request = await _with_body(request, access.most_bytes, model)
                return await handler(request)
            except ClientDisconnect:
                return Response(status_code=400)  # the client has disconnected
            except (StageError, RequestValidationError, HTTPException):
                raise
            except Exception as error:  # noqa: BLE001 - any error gets an answer
                # Starlette would also close the connection.
                _LOG.exception("internal error in an endpoint", endpoint=f"{method} {self.path}")
                return internal_error_answer(error)

        return guarded


class _StrictRequest(Request):
    """A request whose body has been read strictly, and validated if it is long."""

    def __init__(self, request: Request, body: bytes, document: Any) -> None:
        scope = request.scope
        if not body:  # an empty body means an empty object
            scope = {**scope, "headers": [*scope["headers"], _JSON_TYPE]}
        super().__init__(scope, request.receive)
        self._body, self._document = body or b"{}", document

    async def json(self) -> Any:
        """Return the document, or the model that a long document was validated to."""
        return self._document


async def _admitted(request: Request, access: Access) -> RequestContext:
    state: ServiceState = request.app.state.service
    peer = await _peer(request, state)
    context = RequestContext(state, peer, access)
    if peer.role < access.role:
        needed = access.role.name.lower()
        what = f"{peer.user} has the role {peer.role.name.lower()}, this needs {needed}"
        if request.method != "GET":
            context.note(f"{request.method} {request.url.path}", what)
        raise ForbiddenError(what, "become a member of the group piezod or piezod-eng")
    return context


async def _peer(request: Request, state: ServiceState) -> Peer:
    client = request.headers.get("x-piezod-client", "")
    if not _CLIENT.fullmatch(client):
        what = "header X-Piezod-Client: allowed: up to 64 letters, digits and _.:@-"
        raise BadRequestError(what)
    credentials = connection_of(request.scope).credentials
    user = await state.roles.user(credentials)
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
    # A long document would block the event loop, and the loop process would take the supervisor
    # for dead. Hence a thread, and one document at a time.
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
    """Validate a body in place of FastAPI, which accepts a model as a valid document."""
    try:
        return model.model_validate(_read(body))
    except ValidationError as error:
        found = error.errors(include_url=False)
        problems = [{**each, "loc": ("body", *each["loc"])} for each in found]
        raise RequestValidationError(problems) from error


def _refuse_files(document: Any) -> None:
    """Refuse waveforms from files: validation would read any file that a client names."""
    if isinstance(document, dict):
        if document.get("kind") == "csv":
            what = "kind: csv is not allowed here, because the daemon reads no files of clients"
            raise BadValueError(what, "send the values as a waveform of kind points")
        document = tuple(document.values())
    if isinstance(document, tuple):
        for entry in document:
            _refuse_files(entry)


def _too_large(most_bytes: int) -> NoReturn:
    raise TooLargeError(f"the body is too long, allowed here: at most {most_bytes} bytes")
