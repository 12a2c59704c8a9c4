"""The error codes that `ERR?` reports, and which one a refusal of the daemon gets."""

from enum import IntEnum
from typing import Final

from piezod.errors import ClientError, NotAllowedError, NotRunningError


class Code(IntEnum):
    """Error codes of GCS, as in `TranslatePIError.h` of EPICS' motorPIGCS2."""

    NONE = 0
    UNKNOWN_COMMAND = 2
    TOO_LONG = 3
    SERVO_OFF = 5
    POSITION_LIMITS = 7
    VELOCITY_LIMITS = 8
    STOPPED = 10
    UNKNOWN_AXIS = 15
    OUT_OF_RANGE = 17
    WRONG_COUNT = 24
    NOT_A_NUMBER = 25
    NOT_ALLOWED = 34
    """"Command not allowed for selected stage(s)"."""
    UNKNOWN_PARAMETER = 54
    PROTECTED = 60
    """The command level is too low: here, the role of the user."""
    INITIALISING = 63
    NO_CONNECTION = 215
    """"The connection between controller and stage may be broken"."""
    INVALID_SENSOR_SIGNAL = 505
    OTHER_INTERFACE = 733
    """"Fieldbus is active and is blocking GCS control commands": another client has the lease."""


class GcsRefusal(Exception):  # noqa: N818 - an outcome of a command, not a mistake
    """Raised if a command or a query is refused.

    Args:
        code: Error code for `ERR?`.
        why: Reason, for people.
    """

    def __init__(self, code: Code, why: str) -> None:
        super().__init__(code, why)
        self.code, self.why = code, why


_CODES: Final = {
    "lease_held": Code.OTHER_INTERFACE,
    "value": Code.OUT_OF_RANGE,
    "invalid": Code.OUT_OF_RANGE,
    "unavailable": Code.NO_CONNECTION,
    "no_answer": Code.NO_CONNECTION,
    "stopped": Code.STOPPED,
}


def refusal_of(error: ClientError) -> GcsRefusal:
    """Return the refusal for an error of the exchange with the daemon."""
    if isinstance(error, NotAllowedError):
        code = Code.PROTECTED
    elif isinstance(error, NotRunningError) or not error.code:
        code = Code.NO_CONNECTION
    else:
        code = _CODES.get(error.code, Code.NOT_ALLOWED)
    return GcsRefusal(code, str(error))
