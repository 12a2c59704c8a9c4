"""The loop counts by itself what must not happen to it: faults, collections, memory that grows."""

import gc
import resource
import sys
from collections.abc import Sequence

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.telemetry.words import Word


class ProcessCounters:
    """Publishes the counters of this process, as they have grown since `restart`.

    Args:
        words: The words of the shared memory, writable.
    """

    def __init__(self, words: "memoryview[int]") -> None:
        self._words = words
        self.restart()

    def restart(self) -> None:
        """Count from now on; to be called when the loop has become real-time."""
        self._before = (0, 0, 0)
        self._before = self._counts()

    def publish(self) -> Sequence[Detection]:
        """Publish, and return what has come that must not; call it now and then, in the loop.

        It takes some µs.
        """
        minor, major, collections = self._counts()
        words = self._words
        new_faults = major - words[Word.MAJOR_FAULTS]
        collecting = gc.isenabled()  # as in a loop that is not real-time: nothing to tell of
        new_collections = 0 if collecting else collections - words[Word.GC_COLLECTIONS]
        words[Word.MINOR_FAULTS], words[Word.MAJOR_FAULTS] = minor, major
        words[Word.GC_COLLECTIONS] = collections
        words[Word.ALLOCATED_BLOCKS] = sys.getallocatedblocks()
        if not (new_faults or new_collections):
            return ()
        found = ((Fault.L6, new_collections), (Fault.L8, new_faults))
        return [Detection(fault, measured=count, limit=0.0) for fault, count in found if count]

    def _counts(self) -> tuple[int, int, int]:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        collections = sum(generation["collections"] for generation in gc.get_stats())
        minor, major, collected = self._before
        return usage.ru_minflt - minor, usage.ru_majflt - major, collections - collected
