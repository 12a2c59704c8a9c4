"""The process of the lying amplifier, and its trace."""

import csv
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple


class Row(NamedTuple):
    """A line of the amplifier's trace; voltages in V, `text` of a refused write is its voltage."""

    t_s: float
    kind: str
    written_v: float
    before_v: float
    after_v: float
    shown_v: float
    text: str


class AmplifierProcess:
    """The process of the amplifier.

    Args:
        folder: Its folder.

    Attributes:
        port: The serial port that it serves.
    """

    def __init__(self, folder: Path) -> None:
        self.port, self._trace = folder / "port", folder / "trace.csv"
        command = (sys.executable, "-m", "tests.liars.amplifier", str(self.port), str(self._trace))
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
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
            return float(file.read().splitlines()[-1].split(b";")[4])

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
    t_s, kind, written_v, before_v, after_v, shown_v, text = line
    volts = (float(written_v), float(before_v), float(after_v), float(shown_v))
    return Row(float(t_s), kind, *volts, text)
