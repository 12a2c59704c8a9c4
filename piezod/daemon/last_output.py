"""The voltage written last on each axis, in a file of its own that outlives the loop.

`piezod safe` ramps from there where an amplifier tells nothing. Imports nothing but the standard
library and what that imports. The file is some words of eight bytes: count of axes, then for each
axis a number before, the voltage, the instant, and the same number after.
"""

import mmap
import os
from collections.abc import Sequence
from math import nan
from pathlib import Path
from typing import NamedTuple

_WORDS_PER_AXIS = 4


class LastOutput(NamedTuple):
    """What was written last on an axis.

    Attributes:
        drive_v: The voltage, in V; NaN where none was written, or just when the writer died.
        t_ns: When, on CLOCK_MONOTONIC.
    """

    drive_v: float
    t_ns: int


class LastOutputWriter:
    """Keeps the file; one writer.

    Args:
        path: The file; made anew where there is none for so many axes, readable by its owner only.
        axes: How many axes.

    Raises:
        OSError: If it cannot be made.
    """

    def __init__(self, path: Path, axes: int) -> None:
        size = 8 * (1 + _WORDS_PER_AXIS * axes)
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            kept = os.fstat(file).st_size == size
            if not kept:
                os.ftruncate(file, 0)
            os.posix_fallocate(file, 0, size)
            memory = mmap.mmap(file, size, mmap.MAP_SHARED)
        finally:
            os.close(file)
        self._words = memoryview(memory).cast("q")
        self._values = memoryview(memory).cast("d")
        if not kept:
            for axis in range(axes):
                self._values[2 + axis * _WORDS_PER_AXIS] = nan
            self._words[0] = axes

    def note(self, drive_v: Sequence[float], t_ns: int) -> None:
        """Note what is being written on all axes, in V; may be called in the loop.

        Call it before the write: after a crash between the two the note is the safer guess, being
        within one step of slew of what is in force.
        """
        at = 1
        for voltage in drive_v:
            turn = self._words[at] + 1
            self._words[at] = turn
            self._values[at + 1] = voltage
            self._words[at + 2] = t_ns
            self._words[at + 3] = turn
            at += _WORDS_PER_AXIS

    def forget(self, t_ns: int) -> None:
        """Note that what was written last says nothing any more; may be called in the loop."""
        self.note([nan] * self._words[0], t_ns)


def read_last_output(path: Path) -> list[LastOutput]:
    """Return what was written last on each axis; an empty list where nobody noted anything.

    Raises:
        OSError: If the file is there and cannot be read.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return []
    if len(content) < 8 or len(content) % 8:
        return []
    words, values = memoryview(content).cast("q"), memoryview(content).cast("d")
    if len(words) != 1 + _WORDS_PER_AXIS * words[0]:
        return []
    outputs = []
    for at in range(1, len(words), _WORDS_PER_AXIS):
        whole = words[at] == words[at + 3]
        outputs.append(LastOutput(values[at + 1] if whole else nan, words[at + 2]))
    return outputs
