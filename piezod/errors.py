"""The errors that piezod raises on purpose.

::

    PiezodError
    ├── ConfigError               a file that a person wrote cannot be used
    ├── DataError                 recorded data cannot be used
    ├── ModelError                a hysteresis model or a loop with it violates a condition
    ├── RegistryError             a driver's name does not lead to one working plug-in
    ├── DeviceError               a device was used out of order or answered wrongly
    │   └── DeviceUnavailableError    a device is absent, busy or does not answer
    ├── AlreadyRunningError       another daemon owns the stage
    └── ClientError               a running daemon could not be talked to
        ├── NotRunningError           no daemon runs, or not the one that is meant
        ├── AmbiguousStageError       several daemons run, and none is named
        ├── NotAllowedError           the daemon knows who asks and does not let them
        └── RefusedError              the daemon does not do what it is asked to
            └── NotReachedError           a movement ended before its target, or takes too long

Errors are for configuration, opening and mistakes of the caller. Inside a control cycle a fault is
a value, never an exception. Which exit code an error leads to is decided in `piezod.cli` alone.
"""

from typing import NamedTuple


class PiezodError(Exception):
    """Base of every error that piezod raises on purpose; never raised itself."""


class Problem(NamedTuple):
    """One thing that is wrong in a file, and where.

    Attributes:
        file: Path of the file as the user gave it.
        line: Line, counted from 1; 0 when the problem concerns the whole file.
        column: Column, counted from 1; 0 when the problem concerns the whole file.
        path: Where in the document, as in `axes.x.limits.drive_max_v`; empty for the whole file.
        what: What is wrong, what was found, the allowed range with its unit, and the remedy.
    """

    file: str
    line: int
    column: int
    path: str
    what: str

    def __str__(self) -> str:
        """Give the problem as one line that an editor can jump to."""
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        return ": ".join(part for part in (place, self.path, self.what) if part)


class ConfigError(PiezodError):
    """Raised when a configuration, experiment or model file cannot be read or breaks a rule.

    All that is wrong with a file is reported at once; the text has one line for each problem.

    Args:
        *problems: What is wrong, at least one, in the order in which it shall be read.
    """

    def __init__(self, *problems: Problem) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        """Give one line for each problem."""
        return "\n".join(map(str, self.problems))


class DataError(PiezodError):
    """Raised when recorded data has gaps, NaN, unsorted time, wrong columns, or is too short."""


class ModelError(PiezodError):
    """Raised when a model has no inverse, or a loop around it would not be safe.

    Such loops are those of an identifier or of a trim whose gain is too large.
    """


class RegistryError(PiezodError):
    """Raised when a driver's name is unknown or taken twice, or its plug-in cannot be loaded."""


class DeviceError(PiezodError):
    """Raised when a device is used out of order, or answers against its protocol."""


class DeviceUnavailableError(DeviceError):
    """Raised when a device cannot be opened: absent, held by somebody else, or silent."""


class AlreadyRunningError(PiezodError):
    """Raised when a stage is to be taken over that a living daemon owns."""


class ClientError(PiezodError):
    """Raised when a daemon answers nothing, or something that a client does not understand.

    Args:
        what: What is wrong.
        remedy: What would help; empty where nobody knows.
        code: The daemon's short name for it, as in "state"; empty where it is not its answer.
    """

    def __init__(self, what: str, remedy: str = "", code: str = "") -> None:
        super().__init__(what, remedy, code)
        self.what = what
        self.remedy = remedy
        self.code = code

    def __str__(self) -> str:
        """Give what is wrong, then what would help."""
        return f"{self.what}; {self.remedy}" if self.remedy else self.what


class NotRunningError(ClientError):
    """Raised when no daemon listens, or it ended during the conversation."""


class AmbiguousStageError(ClientError):
    """Raised when several stages run and nothing says which one is meant."""


class NotAllowedError(ClientError):
    """Raised when a daemon, or its socket's permissions, keep this user out."""


class RefusedError(ClientError):
    """Raised when a daemon refuses a request: because of its state, a range, a lease, a limit."""


class NotReachedError(RefusedError):
    """Raised when a movement was accepted, but its target is not reached, or not in time."""
