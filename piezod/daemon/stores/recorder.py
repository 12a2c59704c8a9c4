"""Records every cycle to a file, in a thread."""

import errno
import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Final, NamedTuple

from piezod.daemon.logging import logger
from piezod.daemon.stores.edge_source import EdgeSource, Trigger
from piezod.daemon.stores.recorded_files import RecordedFiles, RecordedStage
from piezod.daemon.stores.recording_limits import RecordingLimits, no_room
from piezod.daemon.stores.recordings_folder import RecordingsFolder
from piezod.errors import PiezodError
from piezod.messages.stores import Recording
from piezod.records.recording.header import TelemetryHeader

DRAIN_S: Final = 0.025
"""Period in which the ring is read, in s; it holds the records of many periods."""
MAX_RECORDS: Final = 10_000
"""Records that one read takes at most."""

_CHECK_EVERY: Final = 40
"""Reads of the ring between two checks of the free space: one check a second."""
_FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class RecorderError(PiezodError):
    """Raised when a recording cannot be started or ended now."""


class Recorder:
    """Starts and ends recordings, one at a time.

    `start` and `stop` may block on the disk: call them in a worker thread, one at a time. `status`
    may be read at any time.

    Args:
        stage: What is recorded.
        folder: Folder of the recordings; made if it is absent.
        no_room: Returns why the disk of a folder is too full, or "".

    Raises:
        OSError: If the folder cannot be made.
    """

    def __init__(
        self, stage: RecordedStage, folder: Path, no_room: Callable[[Path], str] = no_room
    ) -> None:
        self.folder = RecordingsFolder(folder)
        self._stage, self._no_room = stage, no_room
        self._limits = RecordingLimits()
        self._ending = Event()
        self._thread: Thread | None = None
        self._lock = Lock()
        self._status = Recording()

    @property
    def status(self) -> Recording:
        """Status of the running recording, or of the last one."""
        with self._lock:
            return self._status

    def start(
        self,
        header: TelemetryHeader,
        label: str = "",
        limits: RecordingLimits = RecordingLimits(),  # noqa: B008 - it cannot change
        begins_ns: int = 0,
        trigger: Trigger | None = None,
    ) -> str:
        """Start a recording with the next cycle, or at an instant, or wait for an edge.

        Args:
            header: Header of the file; the number of weights is filled in.
            label: Label in its name, see `RecordingsFolder.new`.
            limits: How large it and all recordings may become.
            begins_ns: Instant of its first cycle, in ns; 0 for the next cycle.
            trigger: The edge that starts it; time 0 of its file is that of the edge.

        Returns:
            Its name.

        Raises:
            RecorderError: If one is running, the disk is too full, or the file cannot be made.
            ValueError: If the label has characters that are not allowed.
        """
        if self.status.recording:
            raise RecorderError(f"recording {self.status.name} is running; stop it first")
        self._join()  # the thread of a recording that ended by itself
        path = self.folder.new(datetime.now(UTC), label)
        self._limits = limits
        try:
            if why := self._too_full(path.stem):
                raise RecorderError(why)
            make = partial(RecordedFiles, folder=self.folder, path=path, limits=limits)
            if trigger is None:
                files = make(self._stage, header=header, begins_ns=begins_ns)
                work = partial(self._record, files)
            else:
                reader, last = self._stage.open_reader(), self._stage.last
                source = EdgeSource(reader, last, trigger, header.rate_hz)
                work = partial(self._record_from_edge, source, trigger, header, make)
        except OSError as error:
            raise RecorderError(f"the recording cannot be started: {error}") from error
        self._set_status(Recording(True, path.stem, armed=trigger is not None))
        self._ending.clear()  # the last `stop` has set it
        self._thread = Thread(target=work, name="recorder")
        self._thread.start()
        return path.stem

    def stop(self) -> Recording:
        """End the recording after the records that have come so far, and close its file.

        Without a running recording, return the status of the last one; why it ended by itself is
        returned once.
        """
        self._ending.set()
        self._join()
        ended = self.status
        self._set_status(replace(ended, why="", disk_full=False))
        return ended

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _record_from_edge(
        self,
        source: EdgeSource,
        trigger: Trigger,
        header: TelemetryHeader,
        make: Callable[..., RecordedFiles],
    ) -> None:
        try:
            events = self._stage.open_events()  # what happened before the edge is in the file, too
            while not source.seek(MAX_RECORDS):
                if self._ending.wait(DRAIN_S):
                    self._end_armed(f"line {trigger.line} had no rising edge: there is no file")
                    return
            stage = self._stage._replace(open_reader=lambda: source, open_events=lambda: events)
            files = make(stage, header=_begun_at(header, trigger, source.edge_ns))
        except Exception as error:  # noqa: BLE001 - the status must report any end of the thread
            self._end_armed(f"the file cannot be made: {error}")
            return
        self._set_status(replace(self.status, armed=False))
        self._record(files, source)

    def _end_armed(self, why: str) -> None:
        self._set_status(replace(self.status, recording=False, armed=False, why=why))

    def _record(self, files: RecordedFiles, source: EdgeSource | None = None) -> None:
        failure = _failure_of(lambda: self._copy_until_end(files, source))
        not_closed = _failure_of(files.close)  # also after a failure: it keeps what is there
        why, disk_full = failure if failure.why else not_closed
        status = replace(self.status, recording=False, why=why, disk_full=disk_full)
        self._set_status(_with_counts(status, files))
        if why:
            logger("recorder").error("recording ended", name=status.name, why=why)

    def _copy_until_end(self, files: RecordedFiles, source: EdgeSource | None) -> str:
        """Copy records until the end; return why it ends, or "" on request or at an edge."""
        times = 0
        while not self._ending.wait(DRAIN_S):
            self._copy(files)
            if source is not None and source.ended:
                return ""
            times += 1
            if times % _CHECK_EVERY == 0 and (why := self._too_full(files.name)):
                return why
        # The records of the last period; fewer than the most mean that the ring is empty.
        while self._copy(files) == MAX_RECORDS:
            pass
        return ""

    def _copy(self, files: RecordedFiles) -> int:
        """Copy records; return their number."""
        copied = files.copy(MAX_RECORDS)
        self._set_status(_with_counts(self.status, files))
        return copied

    def _too_full(self, writing: str) -> str:
        """Remove old recordings as far as allowed; return why there is no room, or ""."""
        return self.folder.limit(self._limits.total_bytes, writing) or self._no_room(
            self.folder.path
        )

    def _set_status(self, status: Recording) -> None:
        with self._lock:
            self._status = status


def _begun_at(header: TelemetryHeader, trigger: Trigger, edge_ns: int) -> TelemetryHeader:
    """Return the header of a file whose time 0 is an edge."""
    later = timedelta(microseconds=(edge_ns - header.start_ns) / 1000)
    at = datetime.fromisoformat(header.started_at) + later
    told = {"line": trigger.line, "edge": "rising", "edge_ns": edge_ns}
    return replace(
        header,
        started_at=at.isoformat(timespec="milliseconds"),
        start_ns=edge_ns,
        notes={**header.notes, "trigger": json.dumps(told)},
    )


def _with_counts(status: Recording, files: RecordedFiles) -> Recording:
    return replace(status, records=files.records, lost=files.lost, files=files.files)


class _Failure(NamedTuple):
    """Why a recording ends by itself; empty if it does not."""

    why: str
    disk_full: bool


def _failure_of(action: Callable[[], str | None]) -> _Failure:
    """Return the failure of an action: its return value, that the disk is full, or an exception."""
    try:
        too_full = action() or ""
        return _Failure(too_full, bool(too_full))
    except Exception as error:  # noqa: BLE001 - the status must report any end of the thread
        full = isinstance(error, OSError) and error.errno in _FULL
        return _Failure(f"the file cannot be written: {error}", full)
