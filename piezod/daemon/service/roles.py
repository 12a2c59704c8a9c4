"""Who may do what: a role for each user, and the least role for each endpoint."""

import asyncio
import grp
import os
import pwd
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple, Protocol

from piezod.daemon.service.peer_protocol import Credentials
from piezod.daemon.service.stage_service import Role

GROUPS: Final = {"piezod-eng": Role.ENGINEER, "piezod": Role.OPERATOR}
"""Whose members are more than viewers; whoever reaches the socket is one of those at least."""
SMALL_BODY: Final = 1024
LARGE_BODY: Final = 256 * 1024
"""For points of a waveform and for models."""
_KNOWN_FOR_S: Final = 30.0


class Access(NamedTuple):
    """What an endpoint asks of whoever uses it.

    Attributes:
        role: The least role.
        lease: Whether the lease is needed, and renewed.
        urgent: Whether no limit of rate or connections applies.
        most_bytes: How long a body may be.
    """

    role: Role
    lease: bool = False
    urgent: bool = False
    most_bytes: int = SMALL_BODY


_LOOK: Final = Access(Role.VIEWER)
_TOWARDS_SAFETY: Final = Access(Role.OPERATOR, urgent=True)
_MOVE: Final = Access(Role.OPERATOR, lease=True)
_KEEP: Final = Access(Role.OPERATOR)
_CHANGE: Final = Access(Role.ENGINEER, lease=True)

ACCESS: Final[Mapping[tuple[str, str], Access]] = {
    ("GET", "/v1/status"): _LOOK,
    ("GET", "/v1/health"): _LOOK,
    ("GET", "/v1/faults"): _LOOK,
    ("GET", "/v1/realtime"): _LOOK,
    ("GET", "/v1/config"): _LOOK,
    ("GET", "/v1/params"): _LOOK,
    ("GET", "/v1/params/history"): _LOOK,
    ("GET", "/v1/recordings"): _LOOK,
    ("GET", "/v1/recordings/{name}"): _LOOK,
    ("GET", "/v1/telemetry"): _LOOK,
    ("GET", "/v1/openapi"): _LOOK,
    ("GET", "/v1/audit"): Access(Role.OPERATOR),
    ("POST", "/v1/hold"): _TOWARDS_SAFETY,
    ("POST", "/v1/stop"): _TOWARDS_SAFETY,
    ("POST", "/v1/estop"): Access(Role.VIEWER, urgent=True),
    ("POST", "/v1/disarm"): _TOWARDS_SAFETY,
    ("POST", "/v1/arm"): _MOVE,
    ("POST", "/v1/mode"): _MOVE,
    ("POST", "/v1/goto"): _MOVE,
    ("POST", "/v1/wave"): _MOVE._replace(most_bytes=LARGE_BODY),
    ("POST", "/v1/stream"): _MOVE,
    ("POST", "/v1/follow"): _MOVE,
    ("POST", "/v1/resume"): _MOVE,
    ("POST", "/v1/reset"): _MOVE,
    ("POST", "/v1/zero"): _MOVE,
    ("POST", "/v1/lease"): _MOVE,
    ("DELETE", "/v1/lease"): _KEEP,
    ("POST", "/v1/params/save"): _KEEP,
    ("POST", "/v1/recordings/start"): _KEEP,
    ("POST", "/v1/recordings/stop"): _KEEP,
    ("POST", "/v1/condition"): _CHANGE,
    ("POST", "/v1/identify"): _CHANGE._replace(most_bytes=LARGE_BODY),
    ("POST", "/v1/model"): _CHANGE._replace(most_bytes=LARGE_BODY),
    ("POST", "/v1/params/load"): _CHANGE,
    ("POST", "/v1/params/restore"): _CHANGE,
    ("POST", "/v1/reload"): _CHANGE,
    ("POST", "/v1/shutdown"): Access(Role.ENGINEER),
}
"""Every endpoint; one that is missing here cannot be added to the application."""

URGENT: Final = frozenset(endpoint for endpoint, access in ACCESS.items() if access.urgent)


class User(NamedTuple):
    """A user, as the service names him and lets him do things."""

    name: str
    role: Role


class Roles(Protocol):
    """Who is who."""

    async def user(self, credentials: Credentials) -> User:
        """Return the user at the other end of a connection."""
        ...


class GroupRoles:
    """Roles by unix groups; root and the user of the daemon are engineers.

    Args:
        owner_uid: User of the daemon.
        now_s: A clock that never goes back, in s; what is known is looked up again after 30 s.
    """

    def __init__(self, owner_uid: int, now_s: Callable[[], float]) -> None:
        self._owner_uid, self._now_s = owner_uid, now_s
        self._known: dict[tuple[int, int], tuple[float, User]] = {}

    async def user(self, credentials: Credentials) -> User:
        """Return the user at the other end of a connection."""
        key = credentials.uid, credentials.gid
        until_s, user = self._known.get(key, (0.0, None))
        if user is None or self._now_s() >= until_s:
            # A directory service may take its time, hence a thread.
            user = await asyncio.to_thread(self._look_up, *key)
            self._known[key] = self._now_s() + _KNOWN_FOR_S, user
        return user

    def _look_up(self, uid: int, gid: int) -> User:
        try:
            name = pwd.getpwuid(uid).pw_name
            groups = {*os.getgrouplist(name, gid), gid}
        except (KeyError, OSError):  # a container's user may have no entry
            name, groups = str(uid), {gid}
        if uid in (0, self._owner_uid):
            return User(name, Role.ENGINEER)
        roles = [role for group, role in GROUPS.items() if _number(group) in groups]
        return User(name, max(roles, default=Role.VIEWER))


def _number(group: str) -> int | None:
    try:
        return grp.getgrnam(group).gr_gid
    except KeyError:
        return None
