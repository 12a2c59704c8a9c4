"""Records a running stage by its daemon, and reads the recording."""

import re
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from piezod.client import StageClient
from piezod.errors import ClientError, DataError
from piezod.records.recording.joined import joined
from piezod.records.recording.part_names import part_name
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry

_OTHER_CHARACTERS: Final = re.compile(r"[^A-Za-z0-9_-]+")
_LABEL_LETTERS: Final = 32


class StageRecorder:
    """One recording after the other."""

    def __init__(self, client: StageClient) -> None:
        self._client, self._running = client, False

    def start(self, label: str) -> None:
        """Record every cycle from now on.

        Args:
            label: Part of the recording's name, as far as its characters allow.

        Raises:
            ClientError: If the daemon refuses.
        """
        self._client.start_recording(
            _OTHER_CHARACTERS.sub("-", label).strip("-_")[:_LABEL_LETTERS] or None
        )
        self._running = True

    def end(self) -> RecordedTelemetry:
        """End the recording, and return it.

        Raises:
            ClientError: If the daemon refuses.
            DataError: If it has ended by itself.
        """
        recording = self._client.stop_recording()
        self._running = False
        if recording.why:
            raise DataError(f"the recording has ended by itself: {recording.why}")
        with TemporaryDirectory(prefix="piezod-") as folder:
            names = [part_name(recording.name, part) for part in range(1, recording.files + 1)]
            files = [Path(folder) / f"{part}.h5" for part in range(len(names))]
            for name, file in zip(names, files, strict=True):
                self._client.fetch_recording(name, file)
            return joined([read_telemetry(file) for file in files])

    def drop(self) -> None:
        """End a running recording; nobody needs it any more."""
        if self._running:
            self._running = False
            with suppress(ClientError):  # it may have ended by itself
                self._client.stop_recording()
