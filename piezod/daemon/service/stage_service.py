"""The interface of a stage that the HTTP service uses; the supervisor implements it.

Only the service knows HTTP, roles and the lease. No method may block for more than a few
milliseconds unless it is `async`: all clients share one thread.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple, Protocol

from piezod.control.stage.answer import Answer
from piezod.errors import PiezodError
from piezod.messages.answers import Faults, Health, Realtime, Status
from piezod.messages.documents import Document
from piezod.messages.endpoints import Role
from piezod.messages.requests import Request
from piezod.messages.stores import (
    Audit,
    History,
    KeptRecording,
    Loaded,
    Parameters,
    Recording,
    Recordings,
    Reloaded,
    Saved,
)
from piezod.telemetry.arrays import Records


class Peer(NamedTuple):
    """The client that sends a request.

    Attributes:
        uid: User, as the kernel reports it.
        pid: Process, as the kernel reports it; for logs only, because numbers are used again.
        user: Name of the user, or its number if it has no name.
        client: Name of the client in the header `X-Piezod-Client`; "" if it has none.
        role: Role of the user.
    """

    uid: int
    pid: int
    user: str
    client: str
    role: Role


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


class AuditEntry(NamedTuple):
    """A request and its outcome, for the audit.

    Attributes:
        peer: The client that sent it.
        what: The request, for example "goto {'position_um': 12.5}".
        accepted: Whether it was carried out.
        why: Why not; empty if it was carried out.
    """

    peer: Peer
    what: str
    accepted: bool
    why: str = ""


class RecordReader(Protocol):
    """A reader of the ring with its own position; `telemetry.arrays.RingReader` is one."""

    def read(self, limit: int) -> tuple[Records, int]:
        """Return the records since the last call, and the number of lost records.

        Args:
            limit: Largest number of records; further records stay for the next call.

        Returns:
            An array of `telemetry.arrays.record_dtype`, shape (n,), oldest first; and the number.
        """
        ...


class StageService(Protocol):
    """A stage with its recordings, parameters and audit."""

    @property
    def axes(self) -> Sequence[str]:
        """The names of the axes, in the order of a record."""
        ...

    @property
    def recordings_folder(self) -> Path:
        """The folder of the recordings; the file of a recording is `NAME.h5`."""
        ...

    async def request(self, request: Request, peer: Peer) -> Answer:
        """Send a request to the loop, and wait for its answer.

        The service has checked role and lease; `Reset.engineer` is set only for an engineer.

        Raises:
            UnavailableError: If there is no loop, or its mailbox is full.
            NoAnswerError: If it does not answer in time.
        """
        ...

    def stream_setpoint(self, setpoints_um: Mapping[str, float]) -> None:
        """Set the newest setpoint of a stream, in µm, for each axis in the mapping.

        Called after a `Stream` request for these axes was accepted, up to some thousand times per
        second.

        Raises:
            BadValueError: If a value is out of the command range of its axis; no axis is set then.
            NotNowError: If the stage no longer follows the stream.
            UnavailableError: If there is no loop.
        """
        ...

    @property
    def state(self) -> str:
        """State in the newest cycle."""
        ...

    def status(self) -> Status:
        """Return the status of the newest cycle, without lease and role."""
        ...

    def health(self) -> Health:
        """Return whether the loop runs cycles."""
        ...

    def faults(self) -> Faults:
        """Return the faults that are present or latched."""
        ...

    def fault_ids(self, mask: int) -> Sequence[str]:
        """Return the ids of the faults in a mask of a record."""
        ...

    def realtime(self) -> Realtime:
        """Return the real-time settings that the loop requested and obtained."""
        ...

    def metrics(self, *, lease_held: bool, openmetrics: bool) -> bytes:
        """Return the metrics as text; called in a thread.

        Args:
            lease_held: Whether a client has the lease.
            openmetrics: Whether as OpenMetrics; otherwise in the older text format of Prometheus.
        """
        ...

    def config(self) -> Document:
        """Return the configuration in force, as JSON."""
        ...

    async def reload(self, peer: Peer) -> Reloaded:
        """Read the configuration again; replace all of it, or keep the present one.

        Raises:
            BadValueError: If the file is not valid; the text lists every problem.
            NotNowError: If the present state does not allow it.
        """
        ...

    def open_reader(self) -> RecordReader:
        """Return a new reader of the ring that starts with the next record.

        Raises:
            UnavailableError: If there is no ring yet.
        """
        ...

    async def params(self) -> Parameters:
        """Return the parameters in use."""
        ...

    async def params_history(self) -> History:
        """Return the saved parameters, newest first."""
        ...

    async def save_params(self, peer: Peer) -> Saved:
        """Save the parameters in use."""
        ...

    async def load_params(self, sequence: int | None, peer: Peer) -> Loaded:
        """Make the loop use saved parameters.

        Args:
            sequence: Their number; None for the newest.
            peer: The client that asks for it.

        Raises:
            UnknownNameError: If no parameters have that number.
            NotNowError: If the loop does not accept them now, or the file is corrupt or of another
                stage.
        """
        ...

    async def start_recording(
        self, label: str | None, peer: Peer, *, start_s: float | None = None
    ) -> Recording:
        """Start recording every cycle from an instant on.

        Raises:
            BadValueError: If the instant cannot be kept.
            NotNowError: If a recording is in progress, or the disk has no room.
        """
        ...

    async def stop_recording(self, peer: Peer) -> Recording:
        """End the recording and close its file.

        Raises:
            NotNowError: If no recording is in progress.
        """
        ...

    async def recordings(self) -> Recordings:
        """Return the recording in progress, the finished ones, and their folder."""
        ...

    async def keep_recording(self, name: str, peer: Peer, *, kept: bool) -> KeptRecording:
        """Mark a recording as kept, or remove the mark.

        Raises:
            UnknownNameError: If there is none of that name.
        """
        ...

    def audit(self, entry: AuditEntry) -> None:
        """Write an entry to the audit; must not block."""
        ...

    async def played(self) -> Document:
        """Return the record of the last play.

        Raises:
            UnknownNameError: If nothing was played since the daemon started.
        """
        ...

    async def audit_log(self, limit: int) -> Audit:
        """Return the newest `limit` entries of the audit, newest first."""
        ...
