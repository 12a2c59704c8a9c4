"""What the loop counts in each cycle since its start: histograms of its timing and of the errors.

The loop counts, because the supervisor does not follow the ring: at 20 kHz that would cost more
than the loop itself. Limits of the buckets are powers of two, so that a bucket is found without a
search.
"""

from typing import Final, NamedTuple

from piezod.telemetry.layout import BUCKETS, COUNTS_WORDS, ERROR_WORDS
from piezod.telemetry.shared_map import SharedMap

LIMITS: Final = tuple(2**k for k in range(BUCKETS - 1))
"""Upper limit of each bucket but the last, in µs for times and in nm for errors."""
_HISTOGRAM: Final = BUCKETS + 1  # the sum of all values follows the buckets
_LATE, _READ, _WRITE, _LATENESS = range(4)
_DURATION: Final = _LATENESS + _HISTOGRAM
_LAST: Final = BUCKETS - 1
_PM_PER_UM: Final = 1_000_000
_MOST_UM: Final = 1e6
"""A larger error counts as this one, so that no garbage of a sensor overflows the sum."""


class Histogram(NamedTuple):
    """A histogram."""

    #: Number of values in each bucket: up to the limit in `LIMITS`, above the one before; the last
    #: one is without a limit.
    buckets: tuple[int, ...]
    total: int  #: Sum of all values, in thousandths of the unit of the limits.


class CycleCounts(NamedTuple):
    """The counts of a loop."""

    late: int  #: Cycles that began late, or after skipped periods.
    read_ns: int  #: Time spent reading, with the read-back, in ns.
    write_ns: int  #: Time spent writing, in ns.
    lateness: Histogram  #: Lateness of the cycles, in µs.
    duration: Histogram  #: Time from the begin of a cycle to the end of its write, in µs.
    #: Absolute value of command minus position of each axis, in nm; cycles without a command or a
    #: usable sample are left out.
    errors: tuple[Histogram, ...]


class CycleCounter:
    """Counts cycles; the end of the loop.

    Args:
        shared: The memory, writable; it has one writer.
        late_ns: A cycle is late if it begins later than this after its deadline, in ns.
    """

    def __init__(self, shared: SharedMap, late_ns: int) -> None:
        self._words, self._late_ns = shared.part("counts").cast("q"), late_ns
        self._errors = _errors_at(shared)

    def cycle(self, late_ns: int, skipped: int, read_ns: int, write_ns: int, busy_ns: int) -> None:
        """Count a cycle. Real-time safe.

        Args:
            late_ns: Begin after the deadline, in ns.
            skipped: Periods skipped just before it.
            read_ns: Duration of reading, with the read-back, in ns.
            write_ns: Duration of writing, in ns.
            busy_ns: Time from its begin to the end of its write, in ns.
        """
        words = self._words
        if skipped or late_ns > self._late_ns:
            words[_LATE] += 1
        words[_READ] += read_ns
        words[_WRITE] += write_ns
        # One less, so that a value equal to a limit belongs to the bucket below it.
        bucket = ((late_ns and late_ns - 1) // 1000).bit_length()
        words[_LATENESS + (bucket if bucket < _LAST else _LAST)] += 1
        words[_LATENESS + BUCKETS] += late_ns
        bucket = ((busy_ns - 1) // 1000).bit_length()
        words[_DURATION + (bucket if bucket < _LAST else _LAST)] += 1
        words[_DURATION + BUCKETS] += busy_ns

    def error(self, axis: int, error_um: float) -> None:
        """Count the error of an axis in a cycle, in µm; NaN is left out. Real-time safe."""
        if error_um - error_um == 0.0:  # neither NaN nor infinite
            words, at = self._words, self._errors[axis]
            size_um = abs(error_um)
            error_pm = int((size_um if size_um < _MOST_UM else _MOST_UM) * _PM_PER_UM)
            bucket = ((error_pm and error_pm - 1) // 1000).bit_length()
            words[at + (bucket if bucket < _LAST else _LAST)] += 1
            words[at + BUCKETS] += error_pm


def counts_of(shared: SharedMap) -> CycleCounts:
    """Return the counts of a loop; all are 0 before its first cycle."""
    words = shared.part("counts").cast("q")
    return CycleCounts(
        words[_LATE],
        words[_READ],
        words[_WRITE],
        _histogram(words, _LATENESS),
        _histogram(words, _DURATION),
        tuple(_histogram(words, at) for at in _errors_at(shared)),
    )


def _errors_at(shared: SharedMap) -> list[int]:
    """Return the place of the first bucket of each axis."""
    return [COUNTS_WORDS + axis * ERROR_WORDS for axis in range(len(shared.layout.axes))]


def _histogram(words: "memoryview[int]", at: int) -> Histogram:
    return Histogram(tuple(words[at : at + BUCKETS]), words[at + BUCKETS])
