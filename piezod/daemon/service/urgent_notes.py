"""Limits the audit entries of urgent requests, because their own rate has no limit."""

from collections.abc import Callable
from typing import Final

from piezod.daemon.service.rate_limit import TokenBucket
from piezod.daemon.stage.peer import AuditEntry

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
