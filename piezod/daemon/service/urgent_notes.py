"""What is noted of urgent requests, which are served at any rate: not so many of them."""

from collections.abc import Callable
from typing import Final

from piezod.daemon.service.rate_limit import TokenBucket
from piezod.daemon.service.stage_service import AuditEntry

RATE_HZ: Final = 2.0
BURST: Final = 20.0
_MOST_USERS: Final = 256


class UrgentNotes:
    """Lets two entries a second of each user through, and tells how many it left out.

    Args:
        now_s: A clock that never goes back, in s.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._users: dict[int, TokenBucket] = {}
        self._left_out: dict[int, int] = {}

    def limit(self, entry: AuditEntry) -> AuditEntry | None:
        """Return the entry, with the count of those before it that were left out; None for one."""
        uid, now_s = entry.peer.uid, self._now_s()
        if uid not in self._users and len(self._users) >= _MOST_USERS:
            self._users.clear()  # of a machine's users so many are no flood
        bucket = self._users.setdefault(uid, TokenBucket(RATE_HZ, BURST, now_s))
        if not bucket.take(now_s):
            self._left_out[uid] = self._left_out.get(uid, 0) + 1
            return None
        left_out = self._left_out.pop(uid, 0)
        if not left_out:
            return entry
        return entry._replace(what=f"{entry.what} (after {left_out} that are not noted)")
