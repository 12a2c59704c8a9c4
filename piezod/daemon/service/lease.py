"""The lease: the exclusive right of one client to command a stage."""

from collections.abc import Callable
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

    def claim(self, peer: Peer) -> Document:
        """Take the lease or renew it, for 30 s from now.

        Returns:
            The holder, and the time until it expires.

        Raises:
            LeaseHeldError: If another client has it.
        """
        left_s = self._until_s - self._now_s()
        if self._holder is not None and left_s > 0 and not _same(self._holder, peer):
            raise LeaseHeldError(
                f"{_name(self._holder)} holds the lease for another {left_s:.0f} s",
                "wait until it is released or expires; hold, stop, estop and disarm need no lease",
                _document(self._holder, left_s),
            )
        self._holder, self._until_s = peer, self._now_s() + LEASE_S
        return _document(peer, LEASE_S)

    def release(self, peer: Peer) -> bool:
        """Release the lease; return whether the client had it."""
        had = self._holder is not None and _same(self._holder, peer)
        if had:
            self._holder = None
        return had

    def shorten(self, peer: Peer, left_s: float) -> None:
        """Let the lease of a client that disconnected expire in `left_s`, unless it is renewed."""
        if self._holder is not None and _same(self._holder, peer):
            self._until_s = min(self._until_s, self._now_s() + left_s)


def _same(one: Peer, other: Peer) -> bool:
    return (one.uid, one.client) == (other.uid, other.client)


def _name(peer: Peer) -> str:
    return f"{peer.user} ({peer.client})" if peer.client else peer.user


def _document(holder: Peer, left_s: float) -> Document:
    who = {"user": holder.user, "uid": holder.uid, "client": holder.client}
    return {"holder": who, "expires_in_s": left_s}
