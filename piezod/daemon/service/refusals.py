"""Errors of the service itself; `piezod.daemon.stage.errors` has the errors of a stage."""

from piezod.daemon.stage.errors import StageError


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
