"""Errors of requests to a stage; `service.answers` has those of the service itself."""

from typing import ClassVar

from piezod.errors import PiezodError
from piezod.messages.documents import Document


class StageError(PiezodError):
    """Base of the errors of requests; becomes an error document with a status code.

    Args:
        what: What happened, the value found, and the allowed values.
        remedy: What the user can do.
        details: Further keys of the error document.
    """

    status: ClassVar[int] = 500
    code: ClassVar[str] = "internal"

    def __init__(self, what: str, remedy: str = "", details: Document | None = None) -> None:
        super().__init__(what)
        self.what = what
        self.remedy = remedy
        self.details = details or {}


class UnknownNameError(StageError):
    """Raised when a name or number is unknown."""

    status = 404
    code = "not_found"


class NotNowError(StageError):
    """Raised when the present state does not allow a request."""

    status = 409
    code = "refused"


class BadValueError(StageError):
    """Raised when a value has the right type but is not allowed."""

    status = 422
    code = "invalid"


class UnavailableError(StageError):
    """Raised when there is no loop, or too many requests wait for it."""

    status = 503
    code = "unavailable"


class NoAnswerError(StageError):
    """Raised when the loop does not answer in time; the request has expired or is in progress."""

    status = 504
    code = "no_answer"
