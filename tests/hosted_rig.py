"""The simulated rig in a process of its own, as `piezod emulate` makes it."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.forked import Piped, forked


class Write(NamedTuple):
    """A voltage that was written to axis x."""

    asked_ns: int  #: The instant that the caller gave.
    pid: int  #: The caller's process.
    drive_v: float  #: The voltage, in V.


@contextmanager
def hosted(socket: Path, trace: Path, *arguments: str) -> Iterator[Piped]:
    """Host a rig with one axis while the block runs; it has ended in order afterwards."""
    options = ["--socket", str(socket), "--trace", str(trace), *arguments]
    with forked("emulate", "simulated", *options) as process:
        assert "serving" in process.stdout.readline()
        yield process


def writes(trace: Path) -> list[Write]:
    """Read a trace."""
    with trace.open() as file:
        return [
            Write(int(row["asked_ns"]), int(row["pid"]), float(row["x_v"]))
            for row in csv.DictReader(file)
        ]
