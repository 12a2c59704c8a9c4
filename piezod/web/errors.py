"""Errors of a page's request, as the documents that daemons use: code, text and remedy."""

import json
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from starlette.datastructures import Headers
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import Scope

from piezod.client.errors import OTHER_VERSION
from piezod.errors import ClientError, NotAllowedError, NotRunningError
from piezod.messages.documents import Document
from piezod.messages.endpoints import Role

if TYPE_CHECKING:
    import httpcore

NOT_RUNNING: Final = "not_running"
NO_ANSWER: Final = "no_answer"
NOT_ALLOWED: Final = "not_allowed"
GONE: Final = (NOT_RUNNING, NO_ANSWER, NOT_ALLOWED)
"""Codes of the errors of a connection; with all others the daemon itself answers."""
AMBIGUOUS: Final = "ambiguous"
FORBIDDEN: Final = "forbidden"
NOT_FOUND: Final = "not_found"
"""Code of the error that there is no such stage, request or recording."""
_CODES: Final[dict[type[ClientError], str]] = {
    NotRunningError: NOT_RUNNING,
    NotAllowedError: NOT_ALLOWED,
}


class PageError(Exception):
    """Raised if a request of a page cannot be carried out.

    Args:
        code: Short name of the problem.
        what: The problem, for people.
        remedy: What would help.
        details: Further keys of the daemon's error document.
    """

    def __init__(
        self, code: str, what: str, remedy: str = "", details: Document | None = None
    ) -> None:
        super().__init__(code, what, remedy)
        self.document: Document = {**(details or {}), "code": code, "what": what, "remedy": remedy}


def require(role: Role, least: Role) -> None:
    """Check the role that a token gives.

    Raises:
        PageError: If a request needs a larger role.
    """
    if role < least:
        what = f"this token is for looking only, the request needs the role {least.name.lower()}"
        raise PageError(FORBIDDEN, what, "use the other token of `piezod web`")


def refused_file(error: PageError, scope: Scope) -> Response:
    """Return the answer in place of a file: words for a person, else the document of the error."""
    status = 404 if error.document["code"] == NOT_FOUND else 503
    if "text/html" in Headers(scope=scope).get("accept", ""):  # a tab of a browser shows it
        words = filter(None, (error.document["what"], error.document["remedy"]))
        return PlainTextResponse(f"{'; '.join(words)}\n", status)
    return JSONResponse({"error": error.document}, status)


def document_of(response: "httpcore.Response") -> Document:
    """Return the document of a complete answer that is no error.

    Raises:
        PageError: If it is not a JSON object.
    """
    with suppress(ValueError):
        document = json.loads(response.content)
        if isinstance(document, dict):
            return document
    raise PageError("unexpected", "the daemon's answer is not a JSON object", OTHER_VERSION)


def of_answer(response: "httpcore.Response") -> PageError:
    """Return the error of a complete answer, with all keys of the daemon's error document."""
    try:
        error = json.loads(response.content)["error"]
        return PageError(str(error["code"]), str(error["what"]), str(error["remedy"]), error)
    except (ValueError, LookupError, TypeError):
        what = f"the daemon answered with HTTP status {response.status}"
        return PageError("http", what, OTHER_VERSION)


def of_connection(error: ClientError) -> PageError:
    """Return the error of a connection that failed."""
    code = next((code for kind, code in _CODES.items() if isinstance(error, kind)), NO_ANSWER)
    return PageError(error.code or code, error.what, error.remedy)
