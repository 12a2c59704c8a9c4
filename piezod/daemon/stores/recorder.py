"""Recording every cycle to a file, in a thread beside everything else."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from piezod.daemon.logging import logger
from piezod.daemon.stores.recordings_folder import RecordingsFolder
from piezod.errors import PiezodError
from piezod.records.telemetry_header import TelemetryHeader

if TYPE_CHECKING:
    from piezod.records.telemetry_file import TelemetryWriter

DRAIN_S: Final = 0.025
"""How often the ring is emptied; it holds many times that."""
MAX_RECORDS: Final = 10_000
"""How many records are taken at once."""

_CHECK_EVERY: Final = 40
"""How many times the ring is emptied between two looks at the room on the disk."""
_RESERVE_BYTES: Final = 500_000_000
_RESERVE_SHARE: Final = 0.05


class RecordSource(Protocol):
    """What a recording is made from; `telemetry.ring.RingReader` is one."""

    def read(self, limit: int) -> tuple[NDArray[Any], int]:
        """Return up to so many records since the last call, and how many were lost."""
        ...


class RecorderError(PiezodError):
    """Raised when a recording cannot be started or ended now."""


class RecorderStatus(NamedTuple):
    """How a recording stands.

    Attributes:
        recording: Whether it goes on.
        name: Name of the recording, the last one where none goes on; empty before the first.
        records: Records that were taken.
        lost: Records that came too fast for the disk.
        why: Why it ended by itself; empty where it did not.
    """

    recording: bool
    name: str
    records: int
    lost: int
    why: str


def no_room(folder: Path) -> str:
    """Say why a disk is too full to record on; empty where it is not.

    500 MB or 5 %, whichever is more, are left for those who need it more.
    """
    usage = shutil.disk_usage(folder)
    reserve = max(_RESERVE_BYTES, _RESERVE_SHARE * usage.total)
    if usage.free >= reserve:
        return ""
    return (
        f"{usage.free / 1e6:.0f} MB are free in {folder}, needed are {reserve / 1e6:.0f} MB; "
        "delete recordings"
    )


class Recorder:
    """Starts and ends recordings, one at a time.

    `start` and `stop` may block on the disk, so call them in a worker thread, one at a time;
    `status` may be called at any time.

    Args:
        open_reader: Gives a new reader that begins with what comes next.
        dtype: Description of its records, as `telemetry.layout.record_dtype` gives it.
        folder: Where the recordings go; made where absent.
        learned: Gives the weights that axes have now, by their names.
        no_room: Says why a folder's disk is too full; empty where it is not.

    Raises:
        OSError: If the folder cannot be made.
    """

    def __init__(
        self,
        open_reader: Callable[[], RecordSource],
        dtype: np.dtype[np.void],
        folder: Path,
        learned: Callable[[], Mapping[str, npt.ArrayLike]] = dict,
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
        """How the recording stands that goes on, or the last one."""
        with self._lock:
            return self._status

    def start(self, header: TelemetryHeader, label: str = "") -> str:
        """Start a recording with the next cycle.

        Args:
            header: What is said of it as a whole; how many weights there are is filled in.
            label: What to write into its name, see `RecordingsFolder.new`.

        Returns:
            Its name.

        Raises:
            RecorderError: If there is one already, there is no room, or the file cannot be made.
            ValueError: If the label has signs that are not allowed.
        """
        if self.status.recording:
            raise RecorderError(f"recording {self.status.name} goes on; stop it first")
        self._join()
        # HDF5 takes 12 MB of memory; only a supervisor that records pays for it.
        from piezod.records.telemetry_file import TelemetryWriter  # noqa: PLC0415 - see above

        path = self.folder.new(datetime.now(UTC), label)
        try:
            if why := self._no_room(self.folder.path):
                raise RecorderError(why)
            learned = self._learned()
            widths = {axis: np.size(learned[axis]) for axis in header.axes if axis in learned}
            writer = TelemetryWriter(path, replace(header, weights=widths), self._dtype)
        except OSError as error:
            raise RecorderError(f"no recording: {error}") from error
        self._note(RecorderStatus(True, path.stem, 0, 0, ""))
        self._ending.clear()
        arguments = (self._open_reader(), writer)
        self._thread = Thread(target=self._record, args=arguments, name="recorder")
        self._thread.start()
        return path.stem

    def stop(self) -> RecorderStatus:
        """End the recording, with everything that came until now, and close its file.

        Where none goes on, the last one's status is returned.
        """
        self._ending.set()
        self._join()
        return self.status

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _record(self, reader: RecordSource, writer: "TelemetryWriter") -> None:
        why = _failure_of(lambda: self._drain_until_end(reader, writer))
        why_not_closed = _failure_of(writer.close)
        why = why or why_not_closed
        name = self.status.name
        self._note(RecorderStatus(False, name, writer.records, writer.lost, why))
        if why:
            logger("recorder").error("recording ended", name=name, why=why)

    def _drain_until_end(self, reader: RecordSource, writer: "TelemetryWriter") -> str:
        """Return why the recording ends, empty where it was asked to."""
        times = 0
        while not self._ending.wait(DRAIN_S):
            self._drain(reader, writer)
            times += 1
            if times % _CHECK_EVERY == 0 and (why := self._no_room(self.folder.path)):
                return why
        while self._drain(reader, writer) == MAX_RECORDS:
            pass
        return ""

    def _drain(self, reader: RecordSource, writer: "TelemetryWriter") -> int:
        """Return how many records there were."""
        records, lost = reader.read(MAX_RECORDS)
        if len(records):
            for axis, weights in self._learned().items():
                writer.append_weights(axis, int(records["t_ns"][-1]), weights)
        writer.append(records, lost)
        self._note(self.status._replace(records=writer.records, lost=writer.lost))
        return len(records)

    def _note(self, status: RecorderStatus) -> None:
        with self._lock:
            self._status = status


def _failure_of(action: Callable[[], str | None]) -> str:
    """Return why something ends, be it what it returns or what it raises."""
    try:
        return action() or ""
    except Exception as error:  # noqa: BLE001 - a thread's end, whatever its cause, must be told
        return f"the file did not take it: {error}"
