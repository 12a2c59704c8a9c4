"""A simulated clock for tests: it advances when a caller sleeps, and a little at each reading."""

READING_NS = 50
"""Simulated duration of one reading, so that a loop that polls the clock ends."""


class FakeClock:
    """Implements the clock of the loop without real waiting.

    Args:
        start_ns: Initial instant.
    """

    def __init__(self, start_ns: int = 0) -> None:
        self.t_ns = start_ns

    def now_ns(self) -> int:
        """Return the instant; each reading takes 50 ns."""
        self.t_ns += READING_NS
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Advance to this instant."""
        self.t_ns = max(self.t_ns, t_ns)

    def spend_ns(self, duration_ns: int) -> None:
        """Advance by a duration, like a slow call."""
        self.t_ns += duration_ns
