"""Whether the computer was late during a measurement: asked before anything else is judged.

A late cycle says nothing about a sensor, a stage or an amplifier. A measurement with too many of
them is therefore repeated, and if it stays late, that is its error.
"""

from collections.abc import Callable
from typing import Final, NamedTuple, TypeVar

from piezod.errors import LatenessError, PiezodError

ATTEMPTS: Final = 3
"""Number of times that a measurement is tried while it is late."""
LATE_SHARE: Final = 0.1
"""Largest share of late cycles in a measurement, as that of L2 in a running stage."""
UNANSWERED_SHARE: Final = 0.02
"""Largest share of cycles without a reply in time, as that of missing samples in a fit."""
SELDOM_SHARE: Final = 0.01
"""If more cycles began late, the computer was late; otherwise it may have been the devices."""

T = TypeVar("T")


class Lateness(NamedTuple):
    """How late the cycles of a measurement were; a cycle may be late in several ways."""

    cycles: int = 0  #: Number of periods that passed.
    began_late: int = 0  #: Those that began late or were skipped though nothing was in the way.
    overran: int = 0  #: Those that were skipped because the cycle before took too long.
    unanswered: int = 0  #: Cycles in which a device gave no reply in time.
    held: bool = False  #: Whether a running stage has reported lateness that holds it.

    @property
    def spoils(self) -> bool:
        """Whether results need not be those of the stage."""
        late, unanswered = LATE_SHARE * self.cycles, UNANSWERED_SHARE * self.cycles
        return self.began_late > late or self.unanswered > unanswered

    @property
    def excuses(self) -> bool:
        """Whether a failure need not be that of the stage."""
        # Slow devices make cycles overrun now and then, which spoils no result.
        late = self.began_late + self.overran > LATE_SHARE * self.cycles
        return self.held or self.spoils or late

    def plus(self, other: "Lateness") -> "Lateness":
        """Return the lateness of both measurements together."""
        return Lateness(
            self.cycles + other.cycles,
            self.began_late + other.began_late,
            self.overran + other.overran,
            self.unanswered + other.unanswered,
            self.held or other.held,
        )

    def __str__(self) -> str:
        """Return who was late, how much, and what to do."""
        late = self.began_late + self.overran
        numbers = f"{late} of {self.cycles} cycles were late or skipped"
        if self.unanswered:
            numbers += f", and in {self.unanswered} no reply came in time"
        if self.held:
            numbers += ", and the loop reported lateness that lasts"
        if self.held or self.began_late > SELDOM_SHARE * self.cycles:
            return (
                f"the computer was late: {numbers}; end other programs, give piezod a processor "
                "and real-time priority, or lower rate_hz"
            )
        return (
            f"the devices were late: {numbers}; lower rate_hz to what `piezod probe` allows, or "
            "raise the time-out of the device"
        )


def until_punctual(
    measure: Callable[[], T],
    lateness: Callable[[], Lateness],
    again: Callable[[str], object],
    *failures: type[PiezodError],
) -> T:
    """Return the result of a measurement, which is repeated if it was late.

    Args:
        measure: The measurement.
        lateness: Returns the lateness since its last call.
        again: Prepares a repetition; called with its reason, for people.
        failures: Errors of `measure` and `again` that lateness may have caused.

    Raises:
        LatenessError: If it was late each time, or could not be repeated.
    """
    total = Lateness()
    for attempt in range(ATTEMPTS):
        if attempt:
            try:
                again(f"{total}; repeated ({attempt} of {ATTEMPTS - 1})")
            except failures as error:  # a consequence of the lateness, as a latched fault
                raise LatenessError(f"{total}; {error}") from error
        try:
            found = measure()
        except failures as error:
            now = lateness()
            if not (now.excuses or isinstance(error, LatenessError)):
                raise
        else:
            now = lateness()
            if not now.spoils:
                return found
        total = total.plus(now)
    raise LatenessError(str(total))  # without the last error, which may be the wrong reason
