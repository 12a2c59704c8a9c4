"""The routes of the table of commands: strict JSON, first the role, then the body."""

import asyncio
import json
import math
import re
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import is_dataclass
from typing import Any, Final, NoReturn

from fastapi import APIRouter
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import compile_path

from piezod.daemon.logging import logger
from piezod.daemon.service.answers import (
    BadJsonError,
    BadRequestError,
    ForbiddenError,
    JsonAnswer,
    MediaTypeError,
    TooLargeError,
    internal_error_answer,
)
from piezod.daemon.service.connection import connection_of
from piezod.daemon.service.request import RequestContext, ServiceState
from piezod.daemon.stage.errors import BadValueError, StageError
from piezod.daemon.stage.peer import Peer
from piezod.messages.answers import ErrorDocument
from piezod.messages.endpoints import SMALL_BODY, Access, Endpoint
from piezod.messages.requests import TABLE

MAX_DEPTH: Final = 16
_LARGEST_WHOLE: Final = 2**53
_MAX_DIGITS: Final = 18  # of whole numbers, so that they fit into 64 bits


def loads(text: bytes) -> Any:
    """Read a JSON document; lists become tuples, which strict validation requires.

    Raises:
        BadJsonError: If the text is not UTF-8 or not JSON, has a key twice, is nested deeper than
            16 levels, or has a number that is not finite or a whole number of more than 18 digits.
    """
    try:
        return _tuples(_DECODER.decode(text.decode()), MAX_DEPTH)
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # of decoding UTF-8, and of JSON
        raise BadJsonError(f"the body is not JSON: {error}") from error


def _tuples(value: Any, depth: int) -> Any:
    if isinstance(value, dict | list) and depth == 0:
        raise _too_deep()
    if isinstance(value, dict):
        return {_text(key): _tuples(entry, depth - 1) for key, entry in value.items()}
    if isinstance(value, list):
        return tuple([_tuples(entry, depth - 1) for entry in value])
    return _text(value) if isinstance(value, str) else value


def _text(text: str) -> str:
    text.encode()  # half a surrogate pair cannot be written to a log or an answer
    return text


def _too_deep() -> BadJsonError:
    return BadJsonError(f"nested too deeply, allowed: at most {MAX_DEPTH} levels")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise BadJsonError(f"the key {twice[:40]!r} occurs twice, allowed: once")
    return found


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > _MAX_DIGITS:
        what = f"a whole number has {len(digits)} digits, allowed: at most {_MAX_DIGITS}"
        raise BadJsonError(what)
    return int(digits)


def _number(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise BadJsonError(f"the number {digits[:40]} is too large")
    # In JSON 190.0 is a whole number like 190; floats without a fraction convert exactly.
    return int(value) if value.is_integer() and abs(value) < _LARGEST_WHOLE else value


def _constant(name: str) -> NoReturn:
    raise BadJsonError(f"{name} is not JSON, allowed: finite numbers")


_DECODER: Final = json.JSONDecoder(
    object_pairs_hook=_object,
    parse_int=_whole,
    parse_float=_number,
    parse_constant=_constant,
)


PREFIX: Final = "/v1"
ROUTES: Final[Mapping[tuple[str, str], Endpoint]] = {
    (row.method, f"{PREFIX}/{row.path}"): row for row in TABLE.values()
}
"""Every endpoint by method and path; the application has no others."""
URGENT: Final = frozenset(route for route, row in ROUTES.items() if row.access.urgent)
"""The endpoints that are served at any rate and on any connection."""
_ERRORS: Final[dict[int | str, dict[str, Any]]] = {"default": {"model": ErrorDocument}}


_PATTERNS: Final = [(compile_path(path)[0], method) for method, path in ROUTES]


def methods_of(path: str) -> list[str]:
    """Return the methods of the endpoints with a path, sorted."""
    literal = {method for method, template in ROUTES if template == path}
    # Only then: a template such as `recordings/{name}` fits the paths of other endpoints too.
    fitting = {method for pattern, method in _PATTERNS if pattern.fullmatch(path)}
    return sorted(literal or fitting)


def endpoint(
    router: APIRouter, name: str, /, **options: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that adds a function to a router as the endpoint of a row.

    Args:
        router: The router.
        name: Name of the row in the table of commands.
        options: Further arguments of `APIRouter.api_route`.
    """
    row = TABLE[name]
    settings = {
        "responses": _responses(row),
        "response_model": None,
        "response_class": JsonAnswer,
        "description": row.help,
        **options,
    }
    return router.api_route(f"/{row.path}", methods=[row.method], **settings)


def _responses(row: Endpoint) -> dict[int | str, dict[str, Any]]:
    answer = row.answer_class
    if answer is None or not is_dataclass(answer) or row.name == "telemetry":
        return _ERRORS
    fine: dict[int | str, dict[str, Any]] = {200: {"model": answer}}
    if row.also_fine != 200:
        fine[row.also_fine] = {"model": answer, "description": row.help}
    return {**fine, **_ERRORS}


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
