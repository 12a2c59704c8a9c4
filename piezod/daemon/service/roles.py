"""The role of each user, by unix groups."""

import asyncio
import grp
import os
import pwd
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple, Protocol

from piezod.daemon.service.peer_protocol import Credentials
from piezod.messages.endpoints import Role

GROUPS: Final = {"piezod-eng": Role.ENGINEER, "piezod": Role.OPERATOR}
"""Groups and the roles of their members; every other user of the socket is a viewer."""
_KNOWN_FOR_S: Final = 30.0


class User(NamedTuple):
    """Name and role of a user."""

    name: str
    role: Role


class Roles(Protocol):
    """Gives the role of each user."""

    async def user(self, credentials: Credentials) -> User:
        """Return name and role of the user of a connection."""
        ...


class GroupRoles:
    """Roles by unix groups; root and the user of the daemon are engineers.

    Args:
        owner_uid: User of the daemon.
        now_s: Monotonic clock, in s; a role is looked up again after 30 s.
    """

    def __init__(self, owner_uid: int, now_s: Callable[[], float]) -> None:
        self._owner_uid, self._now_s = owner_uid, now_s
        self._known: dict[tuple[int, int], tuple[float, User]] = {}
        # A thread of its own: those of asyncio may all wait for a disk.
        self._threads = ThreadPoolExecutor(1, "roles")

    async def user(self, credentials: Credentials) -> User:
        """Return name and role of the user of a connection."""
        key = credentials.uid, credentials.gid
        until_s, user = self._known.get(key, (0.0, None))
        if user is None or self._now_s() >= until_s:
            # A directory service may be slow, hence a thread.
            loop = asyncio.get_running_loop()
            user = await loop.run_in_executor(self._threads, self._look_up, *key)
            self._known[key] = self._now_s() + _KNOWN_FOR_S, user
        return user

    def _look_up(self, uid: int, gid: int) -> User:
        try:
            name = pwd.getpwuid(uid).pw_name
            groups = {*os.getgrouplist(name, gid), gid}
        except (KeyError, OSError):  # the user of a container may have no entry
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
