"""A clock for tests: it goes on when somebody sleeps by it, and a little when somebody looks."""

READING_NS = 50
"""How long it takes to look at it: whoever spins until an instant gets there."""


class FakeClock:
    """Implements the loop's clock; nobody waits.

    Args:
        start_ns: Instant at which it begins.
    """

    def __init__(self, start_ns: int = 0) -> None:
        self.t_ns = start_ns

    def now_ns(self) -> int:
        """Tell the instant; each look takes 50 ns."""
        self.t_ns += READING_NS
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Be there."""
        self.t_ns = max(self.t_ns, t_ns)

    def spend_ns(self, duration_ns: int) -> None:
        """Let time pass, as something that takes long does."""
        self.t_ns += duration_ns
