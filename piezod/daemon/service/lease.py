"""The lease: the exclusive right of one client to command a stage."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf, isfinite, isinf
from typing import Final, NamedTuple

from piezod.daemon.service.refusals import LeaseHeldError
from piezod.daemon.stage.errors import StageError
from piezod.daemon.stage.peer import Peer
from piezod.messages.answers import Holder
from piezod.messages.answers import Lease as HeldLease

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


class Lease:
    """Belongs to a user and client name; another client gets it when it is released or expires.

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
    def present(self) -> HeldLease | None:
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

    def claim(self, peer: Peer) -> HeldLease:
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

    def bind(self, peer: Peer) -> HeldLease:
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


def _answer(peer: Peer, left_s: float) -> HeldLease:
    return HeldLease(holder=_holder(peer), expires_in_s=left_s if isfinite(left_s) else None)
