"""The exceptions that piezod raises on purpose.

::

    PiezodError
    ├── ConfigError               a configuration, experiment or model file cannot be used
    ├── DataError                 recorded data cannot be used
    │   └── LatenessError             a measurement was late, and cannot be judged
    ├── ModelError                a hysteresis model, or a loop with it, violates a condition
    ├── RegistryError             a driver's name does not lead to exactly one working plug-in
    ├── DeviceError               a device was used out of order or answered wrongly
    │   └── DeviceUnavailableError    a device is absent, busy or does not answer
    │       └── PortHeldError             another program holds the port of a device
    ├── StillDrivenError          a stage could not be brought to its safe voltage
    ├── PlayCancelledError        nobody waits for the rest of a play
    ├── FiguresMissingError       what draws figures is not installed
    ├── AlreadyRunningError       another daemon owns the stage
    └── ClientError               the exchange with a running daemon failed
        ├── NotRunningError           no daemon runs, or not the requested one
        ├── UnreachableError          a daemon runs, and its sockets are gone
        ├── AmbiguousStageError       several daemons run, and the request names none
        ├── NotAllowedError           the user lacks the permission
        ├── GroupError                one of several daemons did not carry out the request
        └── RefusedError              the daemon refuses the request
            └── NotReachedError           a movement ended before its target, or takes too long

Exceptions are for configuration, opening and errors of the caller. Inside a control cycle a fault
is a value, never an exception. `piezod.cli` alone maps exceptions to exit codes.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple


class PiezodError(Exception):
    """Base of all exceptions that piezod raises on purpose; never raised itself."""


class Problem(NamedTuple):
    """One problem of a file, with its place."""

    file: str  #: Path of the file as the user gave it.
    line: int  #: Line, counted from 1; 0 for a problem of the whole file.
    column: int  #: Column, counted from 1; 0 for a problem of the whole file.
    path: (
        str  #: Place in the document, as in `axes.x.limits.drive_max_v`; empty for the whole file.
    )
    what: str  #: The problem, the value found, the allowed range with its unit, and the remedy.

    def __str__(self) -> str:
        """Return the problem as one line that an editor can jump to."""
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        return ": ".join(part for part in (place, self.path, self.what) if part)


class ConfigError(PiezodError):
    """Raised if a configuration, experiment or model file cannot be read or breaks a rule.

    All problems of a file are reported together; the text has one line for each.

    Args:
        *problems: The problems, at least one, in the order of the file.
    """

    def __init__(self, *problems: Problem) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        """Return one line for each problem."""
        return "\n".join(map(str, self.problems))


class DataError(PiezodError):
    """Raised if recorded data has gaps, NaN, unsorted time, wrong columns, or is too short."""


class LatenessError(DataError):
    """Raised if a measurement cannot be judged because the computer, or a device, was late."""


class ModelError(PiezodError):
    """Raised if a model has no inverse, or a loop around it would not be stable.

    Such a loop is that of an identifier or of a trim with too large a gain.
    """


class RegistryError(PiezodError):
    """Raised if a driver's name is unknown or not unique, or its plug-in cannot be loaded."""


class DeviceError(PiezodError):
    """Raised if a device is used out of order, or its answer violates its protocol."""


class DeviceUnavailableError(DeviceError):
    """Raised if a device cannot be opened: absent, held by another program, or silent."""


class PortHeldError(DeviceUnavailableError):
    """Raised if a device cannot be opened because another program holds its port."""


class StillDrivenError(PiezodError):
    """Raised if a stage could not be brought to its safe voltage.

    The text has a line for each such axis: why, and which voltage stays on it.
    """


class PlayCancelledError(PiezodError):
    """Raised between two exchanges with a device if the play was cancelled meanwhile."""


class FiguresMissingError(PiezodError):
    """Raised if figures are to be drawn, and the extra `figures` is not installed."""


class AlreadyRunningError(PiezodError):
    """Raised if a running daemon owns the requested stage already."""


class ClientError(PiezodError):
    """Raised if a daemon does not answer, or its answer cannot be understood.

    Args:
        what: The problem.
        remedy: What would help; empty if it is not known.
        code: Short name of the problem in the daemon's answer, as in "state"; empty without an
            answer.
    """

    def __init__(self, what: str, remedy: str = "", code: str = "") -> None:
        super().__init__(what, remedy, code)
        self.what = what
        self.remedy = remedy
        self.code = code

    def __str__(self) -> str:
        """Return the problem, then the remedy."""
        return f"{self.what}; {self.remedy}" if self.remedy else self.what


class NotRunningError(ClientError):
    """Raised if no daemon listens, or it ended during the exchange."""


class UnreachableError(ClientError):
    """Raised if a daemon runs, but none of its sockets is there.

    Args:
        what: The problem.
        remedy: What would help.
        pid: Process id of the daemon.
    """

    def __init__(self, what: str, remedy: str, pid: int) -> None:
        super().__init__(what, remedy, "unreachable")
        self.pid = pid


class AmbiguousStageError(ClientError):
    """Raised if several stages run and the request names none."""


class NotAllowedError(ClientError):
    """Raised if a daemon, or the permissions of its socket, refuse this user."""


class GroupError(ClientError):
    """Raised if a stage of a group did not carry out a request.

    Args:
        what: The problem, with the names of the stages, and what was taken back.
        remedy: What would help.
        failed: Error of each stage that did not carry it out, by name, at least one.
    """

    def __init__(self, what: str, remedy: str, failed: Mapping[str, ClientError]) -> None:
        super().__init__(what, remedy, next(iter(failed.values())).code)
        self.failed = failed


class RefusedError(ClientError):
    """Raised if a daemon refuses a request: because of its state, a range, a lease, or a limit."""


class NotReachedError(RefusedError):
    """Raised if a movement was accepted, but its target is not reached, or not in time."""


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the name of a file to an error of the operating system that has none.

    A write that finds the disk full, for example, does not know the name of its file.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise
