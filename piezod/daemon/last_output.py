"""The last written voltage of each axis, in a file that outlives the loop.

`piezod safe` ramps from there if the amplifier reports no voltage. This module imports only the
standard library. The file consists of words of eight bytes: the number of axes, then for each axis
a count, the voltage, its instant, and the same count again.
"""

import mmap
import os
from collections.abc import Collection, Sequence
from contextlib import suppress
from math import isnan, nan
from pathlib import Path
from typing import NamedTuple

_WORDS_PER_AXIS = 4


class LastOutput(NamedTuple):
    """The last written voltage of an axis."""

    #: The voltage, in V; NaN if none was written, or if the writer died during a write.
    drive_v: float
    t_ns: int  #: Its instant, on CLOCK_MONOTONIC.


def _allocate(file: int, size: int, path: Path) -> None:
    """Allocate the memory of a file: else a full disk would raise SIGBUS later."""
    try:
        os.posix_fallocate(file, 0, size)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


class LastOutputWriter:
    """Writes the file; there is one writer.

    Args:
        path: The file; if none with this number of axes exists, a new one is made, readable only by
            its owner.
        axes: Number of axes.

    Raises:
        OSError: If it cannot be made.
    """

    def __init__(self, path: Path, axes: int) -> None:
        size = 8 * (1 + _WORDS_PER_AXIS * axes)
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        file = os.open(path, flags, 0o600)
        try:
            # The voltages of an earlier run are kept: this one may die before its first write.
            kept = os.fstat(file).st_size == size
            if not kept:
                os.ftruncate(file, 0)
            _allocate(file, size, path)
            memory = mmap.mmap(file, size, mmap.MAP_SHARED)
        finally:
            os.close(file)
        self._words = memoryview(memory).cast("q")
        self._values = memoryview(memory).cast("d")
        if not kept:
            for axis in range(axes):
                self._values[2 + axis * _WORDS_PER_AXIS] = nan
            self._words[0] = axes
        self.kept_v = [self._values[2 + axis * _WORDS_PER_AXIS] for axis in range(axes)]
        """Last voltage of each axis that an earlier run has stored, in V; NaN if none has."""

    def note(self, drive_v: Sequence[float], t_ns: int) -> None:
        """Store the voltage of each axis that is being written, in V. Real-time safe.

        Call it before the write. After a crash between the two, the stored voltage differs from the
        present one by one step of the slew rate at most. An axis with NaN is not written: its
        stored voltage stays.
        """
        for axis, voltage in enumerate(drive_v):
            if not isnan(voltage):
                self._store(axis, voltage, t_ns)

    def forget(self, t_ns: int, axis: int | None = None) -> None:
        """Store that the voltage of an axis, or of all, is not known any more. Real-time safe."""
        for each in range(self._words[0]) if axis is None else (axis,):
            self._store(each, nan, t_ns)

    def _store(self, axis: int, voltage: float, t_ns: int) -> None:
        word = 1 + axis * _WORDS_PER_AXIS
        count = self._words[word] + 1
        # A reader that finds two different counts knows that the voltage is not complete.
        self._words[word] = count
        self._values[word + 1] = voltage
        self._words[word + 2] = t_ns
        self._words[word + 3] = count


class LastOutputReader:
    """Reads the file, also after it was removed: it is mapped at construction.

    Args:
        path: The file; without one nothing is known.

    Raises:
        OSError: If the file exists and cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._content: mmap.mmap | bytes = b""
        with suppress(FileNotFoundError, NotADirectoryError), path.open("rb") as file:
            if os.fstat(file.fileno()).st_size:
                self._content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)

    def read(self) -> list[LastOutput]:
        """Return the last written voltage of each axis; an empty list without a valid file."""
        content = self._content[:]
        if len(content) < 8 or len(content) % 8:
            return []
        words, values = memoryview(content).cast("q"), memoryview(content).cast("d")
        if len(words) != 1 + _WORDS_PER_AXIS * words[0]:
            return []
        outputs = []
        for word in range(1, len(words), _WORDS_PER_AXIS):
            whole = words[word] == words[word + 3]
            outputs.append(LastOutput(values[word + 1] if whole else nan, words[word + 2]))
        return outputs

    def of(self, axes: Collection[str]) -> dict[str, float]:
        """Return the last written voltage of these axes, in V; NaN if it is not known."""
        noted = self.read()
        if len(noted) != len(axes):  # that of a stage with other axes
            return dict.fromkeys(axes, nan)
        return {name: each.drive_v for name, each in zip(axes, noted, strict=True)}


def stays(last_v: float) -> str:
    """Return which voltage stays on an axis if nobody ramps it down.

    Args:
        last_v: The last written voltage, in V; NaN if it is not known.
    """
    if isnan(last_v):
        return "which voltage stays is not known"
    return f"the voltage stays at {last_v:z.2f} V, the last that the loop wrote"
