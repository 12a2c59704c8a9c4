"""Recordings of a process that was killed."""

import os
import signal
from pathlib import Path

from piezod.records.recording.writer import TelemetryWriter
from tests.records.telemetry import header, record_dtype, records


def killed(path: Path, n_records: int) -> None:
    """Leave a recording of a process that kill -9 has ended."""
    child = os.fork()
    if not child:
        writer = TelemetryWriter(path, header(), record_dtype())
        for begin in range(0, n_records, 50):
            writer.append(records(begin, begin + 50))
        os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
