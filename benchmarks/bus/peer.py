"""The peer: an emulator in a process of its own."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.bus.cases import Case

TCP = "127.0.0.1:0"  # any free port
UDP = "udp:239.74.163.9:43199"


@contextmanager
def emulated(case: Case, folder: Path) -> Iterator[str]:
    """Start the emulator of a case; yield its place while the block runs.

    It runs on other processors than this process, because a real device never waits for the
    processor of the loop. With only one processor they share it.
    """
    places = {"serial": str(folder / "port"), "tcp": TCP, "udp": UDP}
    arguments = ("emulate", case.profile, "--port", places[case.wire], "--json")
    command = [sys.executable, "-m", "piezod.cli.main", *arguments]
    processors = os.sched_getaffinity(0)
    own = {min(processors)}
    os.sched_setaffinity(0, processors - own or own)  # inherited by the process that is started now
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603 - our own
        assert process.stdout is not None  # noqa: S101 - a pipe was asked for
        try:
            line = process.stdout.readline()
            assert line, f"{case.profile} has not started"  # noqa: S101 - its errors are above
            os.sched_setaffinity(0, own)
            yield json.loads(line)["serving"][0]["where"]
        finally:
            os.sched_setaffinity(0, processors)
            process.send_signal(signal.SIGTERM)
            process.wait()
