"""The value of a record, with its alarm."""

from enum import IntEnum
from typing import Final, NamedTuple


class Severity(IntEnum):
    """Severities of EPICS."""

    NO_ALARM = 0
    MINOR = 1
    MAJOR = 2
    INVALID = 3


class Status(IntEnum):
    """The statuses of EPICS that these records have: why there is an alarm."""

    NO_ALARM = 0
    READ = 1
    WRITE = 2
    STATE = 7
    COMM = 9


class Alarm(NamedTuple):
    """An alarm."""

    severity: Severity  #: How serious it is.
    status: Status  #: Why there is one.


OK: Final = Alarm(Severity.NO_ALARM, Status.NO_ALARM)
WARNING: Final = Alarm(Severity.MINOR, Status.STATE)
FAULTY: Final = Alarm(Severity.MAJOR, Status.STATE)
REFUSED: Final = Alarm(Severity.MAJOR, Status.WRITE)
"""The last write was refused."""
UNKNOWN: Final = Alarm(Severity.INVALID, Status.READ)
"""There is no valid value."""
DOWN: Final = Alarm(Severity.INVALID, Status.COMM)
"""The daemon does not answer."""


class Reading(NamedTuple):
    """What a record shows."""

    value: object  #: A number, a truth value, a text, or a list of numbers.
    alarm: Alarm = OK  #: Its alarm.
