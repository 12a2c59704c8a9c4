"""Errors of a page's request, as the documents that daemons use: code, text and remedy."""

import json
from typing import TYPE_CHECKING, Final

from piezod.client.errors import OTHER_VERSION
from piezod.client.results import Document
from piezod.errors import ClientError, NotRunningError

if TYPE_CHECKING:
    import httpcore

NOT_RUNNING: Final = "not_running"
"""Code of the error that a daemon has ended or never ran."""


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
    code = NOT_RUNNING if isinstance(error, NotRunningError) else "no_answer"
    return PageError(error.code or code, error.what, error.remedy)
