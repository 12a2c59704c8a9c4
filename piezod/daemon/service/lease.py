"""The lease: the exclusive right of one client to command a stage."""

from collections.abc import Callable
from math import inf
from typing import Final

from piezod.daemon.service.refusals import LeaseHeldError
from piezod.daemon.service.stage_service import Document, Peer

LEASE_S: Final = 30.0


class Lease:
    """Belongs to a user and client name; another client gets it when it is released or expires.

    Args:
        now_s: Monotonic clock, in s.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._holder: Peer | None = None
        self._until_s = 0.0
        self._bound = False

    def claim(self, peer: Peer) -> Document:
        """Take the lease or renew it, for 30 s from now.

        Returns:
            The holder, and the time until it expires; infinite if the holder has a session.

        Raises:
            LeaseHeldError: If another client has it.
        """
        left_s = self._until_s - self._now_s()
        if self._holder is not None and left_s > 0 and not _same(self._holder, peer):
            how_long = "until its session ends" if self._bound else f"for another {left_s:.0f} s"
            raise LeaseHeldError(
                f"{_name(self._holder)} holds the lease {how_long}",
                "wait until it is released or expires; hold, stop, estop and disarm need no lease",
                _document(self._holder, left_s),
            )
        if self._bound and self._holder is not None:
            return _document(self._holder, inf)
        self._holder, self._until_s = peer, self._now_s() + LEASE_S
        return _document(peer, LEASE_S)

    def bind(self, peer: Peer) -> Document:
        """Take the lease for a session: it does not expire before `unbind`.

        Raises:
            LeaseHeldError: If another client has it, or a process of the same client has a session.
        """
        document = self.claim(peer)
        if self._bound:
            raise LeaseHeldError(
                f"process {self._holder.pid if self._holder else 0} has a session on this stage",
                "wait for its end, or end that process",
                document,
            )
        self._bound, self._until_s = True, inf
        return _document(peer, inf)

    def unbind(self, peer: Peer) -> None:
        """End the session of a client, and release its lease."""
        self._bound = False
        self.release(peer)

    def release(self, peer: Peer) -> bool:
        """Release the lease; return whether that was done: the client had it, without a session."""
        had = self._holder is not None and _same(self._holder, peer) and not self._bound
        if had:
            self._holder = None
        return had

    def shorten(self, peer: Peer, left_s: float) -> None:
        """Let the lease of a client that disconnected expire in `left_s`, unless it is renewed."""
        if self._holder is not None and _same(self._holder, peer) and not self._bound:
            self._until_s = min(self._until_s, self._now_s() + left_s)


def _same(one: Peer, other: Peer) -> bool:
    return (one.uid, one.client) == (other.uid, other.client)


def _name(peer: Peer) -> str:
    return f"{peer.user} ({peer.client})" if peer.client else peer.user


def _document(holder: Peer, left_s: float) -> Document:
    who = {"user": holder.user, "uid": holder.uid, "client": holder.client}
    return {"holder": who, "expires_in_s": left_s}
