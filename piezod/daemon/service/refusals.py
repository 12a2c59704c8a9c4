"""What the service itself refuses, before a stage is asked; the others are `stage_service`'s."""

from piezod.daemon.service.stage_service import StageError


class BadRequestError(StageError):
    """Raised when a request is not understood."""

    status = 400
    code = "bad_request"


class BadJsonError(BadRequestError):
    """Raised when a body or a line is no JSON, or none that has one meaning."""

    code = "bad_json"


class UnknownPeerError(StageError):
    """Raised when the kernel does not tell who asks."""

    status = 401
    code = "unknown_peer"


class ForbiddenError(StageError):
    """Raised when somebody asks for what his role does not allow."""

    status = 403
    code = "forbidden"


class SilentError(StageError):
    """Raised when a stream of setpoints sends none for too long."""

    status = 408
    code = "silent"


class LeaseHeldError(StageError):
    """Raised when somebody else holds the lease."""

    status = 409
    code = "lease_held"


class TooLargeError(StageError):
    """Raised when a body or a line is too long."""

    status = 413
    code = "too_large"


class MediaTypeError(StageError):
    """Raised when a body is not said to be JSON."""

    status = 415
    code = "media_type"


class TooManyError(StageError):
    """Raised when somebody asks too often, or for too much at a time."""

    status = 429
    code = "too_many"
