"""The peer: an emulator in a process of its own."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.bus.cases import Case

TCP = "127.0.0.1:15020"
UDP = "udp:239.74.163.9:43199"


@contextmanager
def emulated(case: Case, folder: Path) -> Iterator[str]:
    """Start the emulator of a case; give where it is served, while the block runs."""
    places = {"serial": str(folder / "port"), "tcp": TCP, "udp": UDP}
    where = places[case.wire]
    command = [sys.executable, "-m", "piezod.cli.main", "emulate", case.profile, "--port", where]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603 - our own
        assert process.stdout is not None  # noqa: S101 - a pipe was asked for
        try:
            process.stdout.readline()
            yield where
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait()
