"""The rate limit: a token bucket for each process, and one for all processes."""

from collections.abc import Callable, Hashable
from typing import Final

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
