"""Answers to clients: JSON documents, and the errors of the service, all with the same form."""

from typing import Any, Final, cast

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse

from piezod.config.messages import describe
from piezod.daemon.stage.errors import StageError
from piezod.messages.documents import Document, dump


class BadRequestError(StageError):
    """Raised when a request has no valid form."""

    status = 400
    code = "bad_request"


class BadJsonError(BadRequestError):
    """Raised when a body or a line is not JSON, or is ambiguous JSON."""

    code = "bad_json"


class UnknownPeerError(StageError):
    """Raised when the kernel does not report the user."""

    status = 401
    code = "unknown_peer"


class ForbiddenError(StageError):
    """Raised when the role of the user does not allow the request."""

    status = 403
    code = "forbidden"


class ForeignPageError(StageError):
    """Raised when a web page of a foreign site may have sent the request."""

    status = 403
    code = "foreign_page"


class SilentError(StageError):
    """Raised when a stream sends no setpoint for too long."""

    status = 408
    code = "silent"


class LeaseHeldError(StageError):
    """Raised when another client holds the lease."""

    status = 409
    code = "lease_held"


class SupersededError(StageError):
    """Raised when another request commands an axis of a stream."""

    status = 409
    code = "superseded"


class TooLargeError(StageError):
    """Raised when a body or a line is too long."""

    status = 413
    code = "too_large"


class MediaTypeError(StageError):
    """Raised when the content type of a body is not JSON."""

    status = 415
    code = "media_type"


class TooManyError(StageError):
    """Raised when a client sends too many requests, or too many at the same time."""

    status = 429
    code = "too_many"


_NOT_ALLOWED: Final = 405


class JsonAnswer(JSONResponse):
    """A message or a document as JSON; NaN and infinities become null."""

    def render(self, content: Any) -> bytes:
        """Return the document as bytes."""
        return dump(content)


def error_answer(error: StageError) -> JsonAnswer:
    """Return the error document of a stage error."""
    return _answer(error.status, error.code, error.what, error.remedy, error.details)


def add_error_answers(app: FastAPI) -> None:
    """Make an application answer every error with an error document."""
    app.add_exception_handler(StageError, _stage_error)
    app.add_exception_handler(RequestValidationError, _not_valid)
    app.add_exception_handler(HTTPException, _http_error)


def _answer(
    status: int, code: str, what: str, remedy: str, details: Document | None = None
) -> JsonAnswer:
    error = {"code": code, "what": what, "remedy": remedy, **(details or {})}
    return JsonAnswer({"error": error}, status)


# The handlers are coroutines, because Starlette would call a function in a thread.


async def _stage_error(_request: Request, error: Exception) -> JsonAnswer:
    return error_answer(cast("StageError", error))


async def _not_valid(_request: Request, error: Exception) -> JsonAnswer:
    problems = []
    for found in cast("RequestValidationError", error).errors():
        where = ".".join(str(part) for part in found["loc"][1:])
        what = describe(found, ())
        problems.append(f"{where}: {what}" if where else what)
    return _answer(
        422, "invalid", "; ".join(problems), "GET /v1/openapi describes the allowed bodies"
    )


async def _http_error(request: Request, error: Exception) -> JsonAnswer:
    status = cast("HTTPException", error).status_code
    codes = {404: "not_found", _NOT_ALLOWED: "method_not_allowed"}
    what = f"{request.method} {request.url.path}: {cast('HTTPException', error).detail}"
    remedy = "GET /v1/openapi lists all endpoints"
    answer = _answer(status, codes.get(status, "http"), what, remedy)
    if status == _NOT_ALLOWED:
        answer.headers["allow"] = ", ".join(request.app.state.methods_of(request.url.path))
    return answer


def internal_error_answer(error: Exception) -> JsonAnswer:
    """Return the error document of an unexpected exception."""
    what = f"internal error of the daemon: {type(error).__name__}"
    return _answer(500, "internal", what, "see the log of the daemon for details, and report them")
