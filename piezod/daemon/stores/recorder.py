"""Records every cycle to a file, in a thread."""

import errno
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from piezod.daemon.logging import logger
from piezod.daemon.stores.recordings_folder import RecordingsFolder
from piezod.errors import PiezodError
from piezod.records.telemetry_header import TelemetryHeader

if TYPE_CHECKING:
    import numpy as np

    from piezod.records.telemetry_file import TelemetryWriter
    from piezod.telemetry.arrays import Records

DRAIN_S: Final = 0.025
"""Period in which the ring is read, in s; it holds the records of many periods."""
MAX_RECORDS: Final = 10_000
"""Records that one read takes at most."""

_CHECK_EVERY: Final = 40
"""Reads of the ring between two checks of the free space: one check a second."""
_RESERVE_BYTES: Final = 500_000_000
_RESERVE_SHARE: Final = 0.05
_FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class RecordSource(Protocol):
    """A source of records; `telemetry.arrays.RingReader` is one."""

    def read(self, limit: int) -> "tuple[Records, int]":
        """Return the records since the last call, at most `limit`, and the number of lost ones."""
        ...


class RecorderError(PiezodError):
    """Raised when a recording cannot be started or ended now."""


class RecorderStatus(NamedTuple):
    """Status of a recording.

    Attributes:
        recording: Whether it is running.
        name: Name of the running or the last recording; empty before the first.
        records: Number of records.
        lost: Number of records that were overwritten before the disk took them.
        why: Why it ended by itself; empty if it did not.
        disk_full: Whether it ended by itself because the disk was full.
    """

    recording: bool
    name: str
    records: int
    lost: int
    why: str
    disk_full: bool = False


def no_room(folder: Path) -> str:
    """Return why a disk is too full for a recording, or "".

    500 MB or 5 % of the disk, whichever is more, are kept free for other uses.
    """
    usage = shutil.disk_usage(folder)
    reserve = max(_RESERVE_BYTES, _RESERVE_SHARE * usage.total)
    if usage.free >= reserve:
        return ""
    return (
        f"{usage.free / 1e6:.0f} MB are free in {folder}, and {reserve / 1e6:.0f} MB must stay "
        "free; delete recordings"
    )


class Recorder:
    """Starts and ends recordings, one at a time.

    `start` and `stop` may block on the disk: call them in a worker thread, one at a time. `status`
    may be read at any time.

    Args:
        open_reader: Returns a new reader that begins with the next record.
        dtype: Returns the dtype of its records, see `telemetry.arrays.record_dtype`.
        folder: Folder of the recordings; made if it is absent.
        learned: Returns the present weights of the axes, by name.
        no_room: Returns why the disk of a folder is too full, or "".

    Raises:
        OSError: If the folder cannot be made.
    """

    def __init__(
        self,
        open_reader: Callable[[], RecordSource],
        dtype: "Callable[[], np.dtype[np.void]]",
        folder: Path,
        learned: Callable[[], Mapping[str, Sequence[float]]] = dict,
        no_room: Callable[[Path], str] = no_room,
    ) -> None:
        self.folder = RecordingsFolder(folder)
        self._open_reader, self._dtype, self._learned = open_reader, dtype, learned
        self._no_room = no_room
        self._ending = Event()
        self._thread: Thread | None = None
        self._lock = Lock()
        self._status = RecorderStatus(False, "", 0, 0, "")

    @property
    def status(self) -> RecorderStatus:
        """Status of the running recording, or of the last one."""
        with self._lock:
            return self._status

    def start(self, header: TelemetryHeader, label: str = "") -> str:
        """Start a recording with the next cycle.

        Args:
            header: Header of the file; the number of weights is filled in.
            label: Label in its name, see `RecordingsFolder.new`.

        Returns:
            Its name.

        Raises:
            RecorderError: If one is running, the disk is too full, or the file cannot be made.
            ValueError: If the label has characters that are not allowed.
        """
        if self.status.recording:
            raise RecorderError(f"recording {self.status.name} is running; stop it first")
        self._join()  # the thread of a recording that ended by itself
        # Imported here: HDF5 takes 12 MB of memory, which only a supervisor that records needs.
        from piezod.records.telemetry_file import TelemetryWriter  # noqa: PLC0415 - see above

        path = self.folder.new(datetime.now(UTC), label)
        try:
            if why := self._no_room(self.folder.path):
                raise RecorderError(why)
            learned = self._learned()
            widths = {axis: len(learned[axis]) for axis in header.axes if axis in learned}
            writer = TelemetryWriter(path, replace(header, weights=widths), self._dtype())
        except OSError as error:
            raise RecorderError(f"the recording cannot be started: {error}") from error
        self._set_status(RecorderStatus(True, path.stem, 0, 0, ""))
        self._ending.clear()  # the last `stop` has set it
        arguments = (self._open_reader(), writer)
        self._thread = Thread(target=self._record, args=arguments, name="recorder")
        self._thread.start()
        return path.stem

    def stop(self) -> RecorderStatus:
        """End the recording after the records that have come so far, and close its file.

        Without a running recording, return the status of the last one; why it ended by itself is
        returned once.
        """
        self._ending.set()
        self._join()
        ended = self.status
        self._set_status(ended._replace(why="", disk_full=False))
        return ended

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _record(self, reader: RecordSource, writer: "TelemetryWriter") -> None:
        failure = _failure_of(lambda: self._drain_until_end(reader, writer))
        not_closed = _failure_of(writer.close)  # also after a failure: it keeps what is there
        why, disk_full = failure if failure.why else not_closed
        name = self.status.name
        self._set_status(RecorderStatus(False, name, writer.records, writer.lost, why, disk_full))
        if why:
            logger("recorder").error("recording ended", name=name, why=why)

    def _drain_until_end(self, reader: RecordSource, writer: "TelemetryWriter") -> str:
        """Copy records until the end; return why it ends, or "" on request."""
        times = 0
        while not self._ending.wait(DRAIN_S):
            self._drain(reader, writer)
            times += 1
            if times % _CHECK_EVERY == 0 and (why := self._no_room(self.folder.path)):
                return why
        # The records of the last period; fewer than the most mean that the ring is empty.
        while self._drain(reader, writer) == MAX_RECORDS:
            pass
        return ""

    def _drain(self, reader: RecordSource, writer: "TelemetryWriter") -> int:
        """Copy records; return their number."""
        records, lost = reader.read(MAX_RECORDS)
        if len(records):
            # The writer stores weights only if they have changed.
            for axis, weights in self._learned().items():
                writer.append_weights(axis, int(records["t_ns"][-1]), weights)
        writer.append(records, lost)
        self._set_status(self.status._replace(records=writer.records, lost=writer.lost))
        return len(records)

    def _set_status(self, status: RecorderStatus) -> None:
        with self._lock:
            self._status = status


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
