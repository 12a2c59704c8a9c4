"""Who asks the stage for something, for roles, lease and audit."""

from typing import NamedTuple

from piezod.messages.endpoints import Role


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
