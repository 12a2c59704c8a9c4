"""The files of one recording: what the stage does is copied to the one that is being written."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from piezod.daemon.stores.recording_limits import RecordingLimits
from piezod.daemon.stores.recordings_folder import RecordingsFolder
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.part_names import part_name
from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.arrays import Records
from piezod.telemetry.learned import LearnedAxis
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S


class RecordSource(Protocol):
    """A source of records; `telemetry.arrays.RingReader` is one."""

    def read(self, limit: int) -> tuple[Records, int]:
        """Return the records since the last call, at most `limit`, and the number of lost ones."""
        ...


class EventSource(Protocol):
    """A source of events; `telemetry.events.EventReader` is one."""

    def read(self) -> tuple[Sequence[StageEvent], int]:
        """Return the events since the last call, and the number of lost ones."""
        ...


class RecordedStage(NamedTuple):
    """What is recorded of a stage."""

    #: Returns a new reader of records that begins with the next one.
    open_reader: Callable[[], RecordSource]
    #: Returns a new reader of events that begins with the next one.
    open_events: Callable[[], EventSource]
    #: Returns the dtype of a record, see `telemetry.arrays.record_dtype`.
    dtype: Callable[[], np.dtype[np.void]]
    #: Returns the present parameters of the axes, by name.
    learned: Callable[[], Mapping[str, LearnedAxis]]
    models: Callable[
        [], Mapping[str, str]
    ]  #: Returns the texts of the model files in use, by axis.
    #: Returns the newest records, at most a given number, oldest first.
    last: Callable[[int], Records]


class RecordedFiles:
    """Copies records, events, weights and models to files that follow each other.

    Every method may block on the disk. Use it from one thread.

    Args:
        stage: What is recorded.
        folder: Folder of the files.
        path: Path of the first file.
        header: Header of the first file; the number of weights is filled in.
        limits: When to go on in another file.
        begins_ns: Instant of the first record, in ns; 0 for the next one.

    Raises:
        OSError: If the file cannot be made.
    """

    def __init__(
        self,
        stage: RecordedStage,
        folder: RecordingsFolder,
        path: Path,
        header: TelemetryHeader,
        limits: RecordingLimits,
        begins_ns: int = 0,
    ) -> None:
        self._stage, self._folder, self._name = stage, folder, path.stem
        self._header, self._limits, self._begins_ns = header, limits, begins_ns
        self.files = 0
        """Number of files."""
        self.records = 0
        """Number of copied records."""
        self.lost = 0
        """Number of records lost before or between them."""
        self._models: Mapping[str, str] = {}
        self._begin_ns: int | None = None
        self._writer = self._next_writer()
        self._reader, self._events = stage.open_reader(), stage.open_events()

    @property
    def name(self) -> str:
        """Name of the file that is being written."""
        return part_name(self._name, self.files)

    def copy(self, limit: int) -> int:
        """Take what is new, at most `limit` records; return their number.

        Records before the start of the recording are dropped.

        Raises:
            OSError: If the disk refuses it.
        """
        records, lost = self._reader.read(limit)
        taken = len(records)
        if not self.records and self._begins_ns:
            records = records[records["t_ns"] >= self._begins_ns]
        if len(records):
            begin_ns, end_ns = int(records["t_ns"][0]), int(records["t_ns"][-1])
            if self._is_full(begin_ns):
                self._writer.close()
                self._writer, self._begin_ns = self._next_writer(), None
            self._begin_ns = begin_ns if self._begin_ns is None else self._begin_ns
            self._copy_models(end_ns)
            # The writer stores weights only if they have changed.
            for axis, at in self._stage.learned().items():
                self._writer.append_weights(axis, end_ns, at.weights, surface=at.surface)
        self._copy_events()
        self._writer.append(records, lost)
        self.records, self.lost = self.records + len(records), self.lost + lost
        return taken

    def close(self) -> None:
        """Write what is left and close the file; a second call does nothing.

        Raises:
            OSError: If the disk refuses it; the file is closed nevertheless.
        """
        self._writer.close()

    def _is_full(self, t_ns: int) -> bool:
        if self._begin_ns is None:
            return False
        too_long = t_ns - self._begin_ns >= self._limits.file_s * NS_PER_S
        return too_long or self._writer.size_bytes >= self._limits.file_bytes

    def _next_writer(self) -> TelemetryWriter:
        self._models = dict(self._stage.models())
        learned = self._stage.learned()
        learned = {axis: at for axis, at in learned.items() if axis in self._header.axes}
        header = replace(
            self._header,
            weights={axis: len(at.weights) for axis, at in learned.items()},
            surfaces=tuple(axis for axis, at in learned.items() if at.surface),
            notes={
                **self._header.notes,
                **{f"model_{axis}": text for axis, text in self._models.items()},
            },
            part=self.files + 1,
        )
        path = self._folder.path_of(part_name(self._name, self.files + 1))
        writer = TelemetryWriter(path, header, self._stage.dtype())
        self.files += 1
        return writer

    def _copy_models(self, t_ns: int) -> None:
        """Note the models that axes have adopted since the last call."""
        models = dict(self._stage.models())
        for axis, text in models.items():
            if text != self._models.get(axis):
                self._writer.append_model(t_ns, axis, text)
        self._models = models

    def _copy_events(self) -> None:
        events, lost = self._events.read()
        self._writer.append_events(events)
        if lost and events:
            text = f"{lost} events before this one were lost"
            self._writer.append_events([StageEvent(events[0].t_ns, "warning", "lost", text)])
