"""What the HTTP service needs of a stage; the supervisor implements it.

The service knows HTTP, roles and the lease; behind this seam nobody knows of them. No method may
block for more than a few milliseconds unless it is `async`: all clients share one thread.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias

import numpy as np

from piezod.config.endpoints import Role
from piezod.config.requests import Request
from piezod.control.stage.record import Answer
from piezod.errors import PiezodError

Document: TypeAlias = dict[str, Any]
"""What becomes a JSON object; a number that is not finite becomes null."""


class Peer(NamedTuple):
    """Who asks.

    Attributes:
        uid: User, as the kernel tells it.
        pid: Process, as the kernel tells it; for logs only, it may be another's by now.
        user: Name of the user, or its number where it has none.
        client: What the client calls itself, header `X-Piezod-Client`; "" where it does not.
        role: What he may do.
    """

    uid: int
    pid: int
    user: str
    client: str
    role: Role


class StageError(PiezodError):
    """Base of what makes a request fail; becomes an error document with a status code.

    Args:
        what: What is wrong: where, what was found, what is allowed.
        remedy: What would help.
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
    """Raised when there is nothing of that name or number."""

    status = 404
    code = "not_found"


class NotNowError(StageError):
    """Raised when something cannot be done now, in this state."""

    status = 409
    code = "refused"


class BadValueError(StageError):
    """Raised when a value is of the right type and not allowed."""

    status = 422
    code = "invalid"


class UnavailableError(StageError):
    """Raised when there is no loop that could be asked, or it has too much to do."""

    status = 503
    code = "unavailable"


class NoAnswerError(StageError):
    """Raised when the loop did not answer in time; the request has expired, or is carried out."""

    status = 504
    code = "no_answer"


class AuditEntry(NamedTuple):
    """Something that somebody asked for, and what became of it.

    Attributes:
        peer: Who.
        what: The request, as in "goto {'position_um': 12.5}".
        accepted: Whether it was carried out.
        why: Why not; empty where it was.
    """

    peer: Peer
    what: str
    accepted: bool
    why: str = ""


class RecordReader(Protocol):
    """A reader of the ring, with a place of its own; `telemetry.ring.RingReader` is one."""

    def read(self, limit: int) -> tuple[np.ndarray, int]:
        """Return the records since the last call, and how many of them were lost.

        Args:
            limit: How many records at most; what is more stays for the next call.

        Returns:
            An array of `telemetry.layout.record_dtype`, shape (n,), oldest first; and a count.
        """
        ...


class StageService(Protocol):
    """A stage, as the HTTP service sees it."""

    @property
    def axes(self) -> Sequence[str]:
        """The names of the axes, in the order in which they are in a record."""
        ...

    @property
    def recordings_folder(self) -> Path:
        """Where the recordings are; the file of a recording is `NAME.h5` in it."""
        ...

    async def request(self, request: Request, peer: Peer) -> Answer:
        """Have the loop carry out a request, and wait for its answer.

        Roles and lease have been checked; `Reset.engineer` is set only for an engineer.

        Raises:
            UnavailableError: If there is no loop, or its mailbox is full.
            NoAnswerError: If it does not answer in time.
        """
        ...

    def stream_setpoint(self, setpoints_um: Mapping[str, float]) -> None:
        """Set the newest setpoint of a stream, for each axis named, in µm.

        Called only after a `Stream` request for these axes was accepted, up to some thousand times
        a second.

        Raises:
            BadValueError: If an axis' command range does not allow its value; none is set then.
            NotNowError: If the stage does not follow the stream any more.
            UnavailableError: If there is no loop.
        """
        ...

    def status(self) -> Document:
        """Return `{"state", "mode", "faults", "skipped_cycles", "axes": {…}}`."""
        ...

    def health(self) -> tuple[bool, Document]:
        """Return whether the loop runs on schedule, and what tells so."""
        ...

    def faults(self) -> list[Document]:
        """Return what is present or latched: `{"id", "name", "present", "latched", "remedy"}`."""
        ...

    def fault_ids(self, mask: int) -> Sequence[str]:
        """Return the ids of the faults in a mask of a record."""
        ...

    def realtime(self) -> Document:
        """Return what the loop process asked of the operating system, and what it obtained."""
        ...

    def config(self) -> Document:
        """Return the configuration in force, as JSON."""
        ...

    async def reload(self, peer: Peer) -> Document:
        """Read the configuration again; it is swapped as a whole, or kept.

        Raises:
            BadValueError: If the file is not valid; the text has every problem.
            NotNowError: If it cannot be swapped in this state.
        """
        ...

    def open_reader(self) -> RecordReader:
        """Return a new reader of the ring that begins with what comes next.

        Raises:
            UnavailableError: If there is no ring yet.
        """
        ...

    async def params(self) -> Document:
        """Return the parameters that the loop uses now: `{"axes": {"x": {…}}, "sequence"}`."""
        ...

    async def params_history(self) -> list[Document]:
        """Return what is saved, newest first: `{"sequence", "saved_at", "saved_by", …}`."""
        ...

    async def save_params(self, peer: Peer) -> Document:
        """Save the parameters in use; returns at least `{"sequence"}`."""
        ...

    async def load_params(self, sequence: int | None, peer: Peer) -> Document:
        """Have the loop use saved parameters; returns at least `{"sequence"}`.

        Args:
            sequence: Which; None for the newest.
            peer: Who asks.

        Raises:
            UnknownNameError: If there are none of that number.
            NotNowError: If the loop does not take them now, or the file is corrupt or foreign.
        """
        ...

    async def start_recording(self, label: str | None, peer: Peer) -> Document:
        """Start recording every cycle; returns at least `{"name"}`.

        Raises:
            NotNowError: If one is under way, or there is no room.
        """
        ...

    async def stop_recording(self, peer: Peer) -> Document:
        """End the recording and close its file; returns at least `{"name", "records", "lost"}`.

        Raises:
            NotNowError: If none is under way.
        """
        ...

    async def recordings(self) -> tuple[Document | None, list[Document]]:
        """Return the one under way, or None, and those that are finished; each has a "name"."""
        ...

    def audit(self, entry: AuditEntry) -> None:
        """Note what somebody asked for; must not block."""
        ...

    async def audit_log(self, limit: int) -> list[Document]:
        """Return the newest entries, newest first."""
        ...
