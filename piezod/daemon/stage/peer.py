"""Who asks the stage for something, for roles, lease and audit."""

from typing import NamedTuple

from piezod.messages.endpoints import Role


class Peer(NamedTuple):
    """The client that sends a request."""

    uid: int  #: User, as the kernel reports it.
    pid: int  #: Process, as the kernel reports it; for logs only, because numbers are used again.
    user: str  #: Name of the user, or its number if it has no name.
    client: str  #: Name of the client in the header `X-Piezod-Client`; "" if it has none.
    role: Role  #: Role of the user.


class AuditEntry(NamedTuple):
    """A request and its outcome, for the audit."""

    peer: Peer  #: The client that sent it.
    what: str  #: The request, for example "goto {'position_um': 12.5}".
    accepted: bool  #: Whether it was carried out.
    why: str = ""  #: Why not; empty if it was carried out.
