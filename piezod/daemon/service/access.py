"""Who may do what: roles of users, the lease, and limits of the rate of requests."""

import asyncio
import grp
import os
import pwd
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from math import inf, isfinite, isinf
from typing import Final, NamedTuple, Protocol

from piezod.daemon.service.answers import LeaseHeldError
from piezod.daemon.service.connection import Credentials
from piezod.daemon.stage.errors import StageError
from piezod.daemon.stage.peer import AuditEntry, Peer
from piezod.messages.answers import Holder, Lease
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


LEASE_S: Final = 30.0
_NO_ANSWER: Final = 500
"""From this HTTP status on an error does not tell whether the request was refused."""


class Holding(NamedTuple):
    """A client that has the lease."""

    peer: Peer  #: The client.
    until_s: float  #: Instant at which the lease expires, in s; infinite during a session.

    @property
    def bound(self) -> bool:
        """Whether the client has a session."""
        return isinf(self.until_s)


class LeaseKeeper:
    """Gives the lease to a user and client name, to others when it is released or expires.

    Args:
        now_s: Monotonic clock, in s.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._held: Holding | None = None

    @property
    def held(self) -> bool:
        """Whether a client has it."""
        return self._held is not None and self._held.until_s > self._now_s()

    @property
    def present(self) -> Lease | None:
        """The holder, and the time until it expires; None if the lease is free."""
        held = self._held
        if held is None or not self.held:
            return None
        return _answer(held.peer, held.until_s - self._now_s())

    def check(self, peer: Peer) -> Holding | None:
        """Return the holding that is in force; None if the lease is free.

        Raises:
            LeaseHeldError: If another client has it.
        """
        held, now_s = self._held, self._now_s()
        if held is None or held.until_s <= now_s:
            return None
        if not _same(held.peer, peer):
            left_s = held.until_s - now_s
            how_long = "until its session ends" if held.bound else f"for another {left_s:.0f} s"
            raise LeaseHeldError(
                f"{_holder(held.peer)} holds the lease {how_long}",
                "wait until it is released or expires; hold, stop, estop and disarm need no lease",
                vars(_answer(held.peer, left_s)),
            )
        return held

    def claim(self, peer: Peer) -> Lease:
        """Take the lease or renew it, for 30 s from now.

        Returns:
            The holder, and the time until it expires; infinite if the holder has a session.

        Raises:
            LeaseHeldError: If another client has it.
        """
        held = self.check(peer)
        if held is not None and held.bound:
            return _answer(held.peer, inf)
        self._held = Holding(peer, self._now_s() + LEASE_S)
        return _answer(peer, LEASE_S)

    @contextmanager
    def claimed(self, peer: Peer) -> Iterator[None]:
        """Claim the lease; a client that did not have it loses it if its request is refused.

        Raises:
            LeaseHeldError: If another client has it.
        """
        before = self.check(peer)
        self.claim(peer)
        mine = self._held
        try:
            yield
        except StageError as error:
            # Not after a missing answer: the request may be carried out. Nor if another request of
            # the client has renewed the lease meanwhile.
            if before is None and error.status < _NO_ANSWER and self._held is mine:
                self._held = None
            raise

    def bind(self, peer: Peer) -> Lease:
        """Take the lease for a session: it does not expire before `unbind`.

        Raises:
            LeaseHeldError: If another client has it, or a process of the same client has a session.
        """
        held = self.check(peer)
        if held is not None and held.bound:
            raise LeaseHeldError(
                f"process {held.peer.pid} has a session on this stage",
                "wait for its end, or end that process",
                vars(_answer(held.peer, inf)),
            )
        self._held = Holding(peer, inf)
        return _answer(peer, inf)

    def unbind(self, peer: Peer) -> None:
        """End the session of a client, and release its lease."""
        if self._held is not None and _same(self._held.peer, peer):
            self._held = None

    def release(self, peer: Peer) -> bool:
        """Release the lease; return whether that was done: the client had it, without a session."""
        held = self._held
        had = held is not None and _same(held.peer, peer) and not held.bound
        if had:
            self._held = None
        return had

    def shorten(self, peer: Peer, left_s: float) -> None:
        """Let the lease of a client that disconnected expire in `left_s`, unless it is renewed."""
        held = self._held
        if held is not None and _same(held.peer, peer) and not held.bound:
            self._held = held._replace(until_s=min(held.until_s, self._now_s() + left_s))


def _same(one: Peer, other: Peer) -> bool:
    return (one.uid, one.client) == (other.uid, other.client)


def _holder(peer: Peer) -> Holder:
    return Holder(user=peer.user, uid=peer.uid, client=peer.client)


def _answer(peer: Peer, left_s: float) -> Lease:
    return Lease(holder=_holder(peer), expires_in_s=left_s if isfinite(left_s) else None)


CLIENT_RATE_HZ: Final = 50.0
CLIENT_BURST: Final = 100.0
TOTAL_RATE_HZ: Final = 200.0
TOTAL_BURST: Final = 400.0
_MAX_CLIENTS: Final = 1024


class TokenBucket:
    """Admits a burst of limited size, and a limited rate in the long run.

    Args:
        rate_hz: Rate at which it fills, in tokens per second.
        burst: Its capacity, in tokens; it starts full.
        now_s: Present time, in s.
    """

    def __init__(self, rate_hz: float, burst: float, now_s: float) -> None:
        self._rate_hz, self._burst = rate_hz, burst
        self._tokens, self._filled_s = burst, now_s

    def take(self, now_s: float) -> bool:
        """Take a token; return whether there was one."""
        self._fill(now_s)
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def is_full(self, now_s: float) -> bool:
        """Return whether the bucket is full again, so that it need not be kept."""
        self._fill(now_s)
        return self._tokens == self._burst

    def _fill(self, now_s: float) -> None:
        gained = (now_s - self._filled_s) * self._rate_hz
        self._tokens, self._filled_s = min(self._tokens + gained, self._burst), now_s


class RateLimit:
    """Admits requests, at most 50/s from one client and 200/s from all of them.

    Args:
        now_s: Monotonic clock, in s.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._total = TokenBucket(TOTAL_RATE_HZ, TOTAL_BURST, now_s())
        self._clients: dict[Hashable, TokenBucket] = {}

    def admit(self, client: Hashable) -> bool:
        """Return whether to serve a client now; its refused requests do not count for others."""
        now_s = self._now_s()
        bucket = self._clients.get(client) or self._new(client, now_s)
        return bucket is not None and bucket.take(now_s) and self._total.take(now_s)

    def _new(self, client: Hashable, now_s: float) -> TokenBucket | None:
        if len(self._clients) >= _MAX_CLIENTS:
            self._clients = {
                key: bucket for key, bucket in self._clients.items() if not bucket.is_full(now_s)
            }
        if len(self._clients) >= _MAX_CLIENTS:
            return None
        self._clients[client] = TokenBucket(CLIENT_RATE_HZ, CLIENT_BURST, now_s)
        return self._clients[client]


RATE_HZ: Final = 2.0
BURST: Final = 20.0
_MOST_USERS: Final = 256


class UrgentNotes:
    """Passes two entries per second of each user, and reports the number of dropped entries.

    Args:
        now_s: Monotonic clock, in s.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._users: dict[int, TokenBucket] = {}
        self._left_out: dict[int, int] = {}

    def limit(self, entry: AuditEntry) -> AuditEntry | None:
        """Return the entry, with the number of entries dropped before it; None to drop it."""
        uid, now_s = entry.peer.uid, self._now_s()
        if uid not in self._users and len(self._users) >= _MOST_USERS:
            self._users.clear()  # no machine has so many users at a time, so start anew
        bucket = self._users.setdefault(uid, TokenBucket(RATE_HZ, BURST, now_s))
        if not bucket.take(now_s):
            self._left_out[uid] = self._left_out.get(uid, 0) + 1
            return None
        left_out = self._left_out.pop(uid, 0)
        if not left_out:
            return entry
        return entry._replace(what=f"{entry.what} (after {left_out} that are not noted)")
