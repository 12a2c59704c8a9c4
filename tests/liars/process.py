"""The process of the lying amplifier, and its trace."""

import csv
import os
import subprocess
import sys
from pathlib import Path
from typing import Literal, NamedTuple


class Row(NamedTuple):
    """A line of the amplifier's trace; voltages in V, `text` of a refused write is its voltage.

    Kinds: `opened` by a process, `sense` by the sensor, `read` back, `write`, `refused`, `load` of
    a table, `start` of a play, which is its first point, `play` of each other point, `end` of a
    play by itself, `late` for a write that takes effect, `own` for a step by itself, and `mark`.
    """

    t_s: float
    kind: str
    written_v: float
    before_v: float
    after_v: float
    shown_v: float
    position_um: float
    text: str


Speaks = Literal["lines", "gcs"]
"""How the amplifier speaks: in lines, or in GCS 2, which can play tables."""


class AmplifierProcess:
    """The process of the amplifier."""

    def __init__(self, folder: Path, speaks: Speaks = "lines") -> None:
        self.port, self._trace = folder / "port", folder / "trace.csv"
        command = (sys.executable, "-m", "tests.liars.serve", str(self.port), str(self._trace))
        self._process = subprocess.Popen(
            (*command, speaks), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._answered()

    def tell(self, order: str) -> None:
        """Give it an order."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{order}\n")
        self._answered()

    def rows(self) -> list[Row]:
        """Return its trace."""
        with self._trace.open(newline="") as file:
            return [_row(line) for line in csv.reader(file, delimiter=";")]

    def output_v(self) -> float:
        """Return the voltage on the stage, in V."""
        self.tell("mark look")
        with self._trace.open("rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 200))
            *_, whole, _partial = file.read().split(b"\n")
        return float(whole.split(b";")[4])

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()

    def _answered(self) -> None:
        assert self._process.stdout is not None
        assert self._process.stdout.readline()


def _row(line: list[str]) -> Row:
    """Read a line of the trace."""
    t_s, kind, *numbers, text = line
    written_v, before_v, after_v, shown_v, position_um = map(float, numbers)
    return Row(float(t_s), kind, written_v, before_v, after_v, shown_v, position_um, text)
