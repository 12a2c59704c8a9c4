"""The self-test of a stage, which ends BOOT. Configuration and devices were checked before."""

from piezod.control.stage.states import Event


class SelfTest:
    """Decides when and where BOOT ends. Real-time safe.

    Attributes:
        ended: Whether BOOT has ended since the process started.
        waits: Whether BOOT lasts on, because cycles are only measured: they run faster than their
            period.
        ramps_first: Whether a voltage that the last daemon has left is ramped down first.
    """

    def __init__(self) -> None:
        self.ended = self.waits = self.ramps_first = False

    def end(self, *, at_safe: bool, blocked: bool, output_known: bool) -> Event | None:
        """Return the event that ends BOOT, None while it lasts.

        Args:
            at_safe: Whether read-back and last write of every axis are at the safe voltage.
            blocked: Whether a latched fault stops the stage.
            output_known: Whether the voltages in force are known.
        """
        if self.waits:
            return None
        self.ended = True
        if self.ramps_first and output_known and not at_safe:
            return Event.FOUND_DRIVEN
        return Event.SELF_TEST_FAILED if blocked else Event.SELF_TEST_PASSED
