"""A recording of a running stage that went on in another file."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import LiveStage
from piezod.records.recording.writer import TelemetryWriter
from tests.experiment.live_fakes import FakeStage
from tests.records.telemetry import header, record_dtype, records


class RotatingStage(FakeStage):
    """Has recorded two files."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    def fetch_recording(self, name: str, file: Path) -> int:
        shutil.copy(self.folder / f"{name}.h5", file)
        return 1

    def _answer(self, path: str, body: Mapping[str, Any]) -> dict[str, Any]:
        answer = super()._answer(path, body)
        return {**answer, "files": 2} if path == "recordings/stop" else answer


def test_files_of_a_recording_are_one(tmp_path: Path) -> None:
    """All files are fetched, and their cycles follow each other."""
    for name, begin in (("recording", 0), ("recording-0002", 1000)):
        with TelemetryWriter(tmp_path / f"{name}.h5", header(), record_dtype()) as writer:
            writer.append(records(begin, begin + 1000))
    client = RotatingStage(tmp_path)
    with LiveStage(client, read_setup(client), lambda _s: None) as stage:
        stage.recorder.start("scan")
        recorded = stage.recorder.end()

    np.testing.assert_array_equal(recorded.cycles["seq"], np.arange(2000))
