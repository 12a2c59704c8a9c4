"""Counts what a real-time loop must avoid: page faults, garbage collections, growing memory."""

import gc
import resource
import sys
from collections.abc import Sequence

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.telemetry.words import Word


class ProcessCounters:
    """Publishes the counters of this process, counted since `restart`.

    Args:
        words: The words of the shared memory, writable.
    """

    def __init__(self, words: "memoryview[int]") -> None:
        self._words = words
        self.restart()

    def restart(self) -> None:
        """Count from now on; call it when the loop has become real-time."""
        self._before = (0, 0, 0)  # `_counts` subtracts it
        self._before = self._counts()

    def publish(self) -> Sequence[Detection]:
        """Publish the counters; return a detection of each that grew and must not. Real-time safe.

        It takes some µs; once a second is enough.
        """
        minor, major, collections = self._counts()
        words = self._words
        new_faults = major - words[Word.MAJOR_FAULTS]
        collecting = gc.isenabled()  # the collector was never switched off: collections are normal
        new_collections = 0 if collecting else collections - words[Word.GC_COLLECTIONS]
        words[Word.MINOR_FAULTS], words[Word.MAJOR_FAULTS] = minor, major
        words[Word.GC_COLLECTIONS] = collections
        words[Word.ALLOCATED_BLOCKS] = sys.getallocatedblocks()
        if not (new_faults or new_collections):
            return ()
        found = ((Fault.L6, new_collections), (Fault.L8, new_faults))
        return [Detection(fault, measured=count, limit=0.0) for fault, count in found if count]

    def _counts(self) -> tuple[int, int, int]:
        """Return minor page faults, major page faults and collections since `restart`."""
        usage = resource.getrusage(resource.RUSAGE_SELF)
        collections = sum(generation["collections"] for generation in gc.get_stats())
        minor, major, collected = self._before
        return usage.ru_minflt - minor, usage.ru_majflt - major, collections - collected
