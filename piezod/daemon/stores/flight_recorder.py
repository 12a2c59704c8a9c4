"""The flight recorder: writes the seconds before and after a fault, by itself."""

import json
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Lock
from typing import Final

from piezod.daemon.stores.recordings_folder import RecordingsFolder
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.writer import TelemetryWriter
from piezod.telemetry.arrays import Records
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S

BEFORE_NS: Final = 10 * NS_PER_S
AFTER_NS: Final = 2 * NS_PER_S
PAUSE_NS: Final = 10 * NS_PER_S
"""Pause after a file, so that a flickering fault does not fill the disk."""
KEPT: Final = 50
"""Number of files that are kept."""
MAX_EVENTS: Final = 1000
"""Largest number of events in a file; at most half of them are from before the fault."""


class FlightRecorder:
    """Collects events, and writes them with the cycles around the first fault.

    `take_event` and `is_due` cost next to nothing. The other methods may block on the disk: call
    them in a worker thread.

    Args:
        last: Returns the newest records, at most a given number, oldest first.
        folder: Folder of the files; made if it is absent.
        now: The time of day.

    Raises:
        OSError: If the folder cannot be made.
    """

    def __init__(
        self,
        last: Callable[[int], Records],
        folder: Path,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self.folder = RecordingsFolder(folder)
        self._last, self._now = last, now
        self._lock = Lock()
        self._events = deque[StageEvent]()
        self._fault: StageEvent | None = None
        self._not_before_ns: int | None = None

    def take_event(self, event: StageEvent) -> None:
        """Take an event; the first fault of severity "error" triggers a file, due 2 s later."""
        with self._lock:
            if self._fault is not None:  # a file is due: what follows the fault is added to it
                if len(self._events) < MAX_EVENTS:
                    self._events.append(event)
                return
            before, oldest_ns = self._events, event.t_ns - BEFORE_NS
            while len(before) > MAX_EVENTS // 2 or (before and before[0].t_ns < oldest_ns):
                before.popleft()
            before.append(event)
            if (
                event.kind == "fault"
                and event.severity == "error"
                and self._may_trigger(event.t_ns)
            ):
                self._fault = event

    def is_due(self, now_ns: int) -> bool:
        """Return whether a file is due; costs next to nothing."""
        with self._lock:
            return self._fault is not None and now_ns >= self._fault.t_ns + AFTER_NS

    def write_now(self, header: TelemetryHeader, now_ns: int) -> Path | None:
        """Write the file of a fault, if there was one, due or not.

        Args:
            header: Header of the stage; title, notes and instants are filled in.
            now_ns: Now, on the clock of the records.

        Returns:
            The file that was written; None without a fault.

        Raises:
            OSError: If it cannot be written; there is no second attempt.
        """
        with self._lock:
            fault, events = self._fault, list(self._events)
            self._fault = None  # before the write: a failure is not repeated
            self._events.clear()
            if fault is None:
                return None
            self._not_before_ns = now_ns + PAUSE_NS
        return self._write(header, fault, events, now_ns)

    def _may_trigger(self, t_ns: int) -> bool:
        return self._not_before_ns is None or t_ns >= self._not_before_ns

    def _write(
        self, header: TelemetryHeader, fault: StageEvent, events: list[StageEvent], now_ns: int
    ) -> Path:
        # Records and events have monotonic instants; the file has the time of day of the fault.
        happened = self._now() - timedelta(microseconds=(now_ns - fault.t_ns) / 1000)
        span_s = (BEFORE_NS + now_ns - fault.t_ns) / NS_PER_S
        records = self._last(round(span_s * header.rate_hz) + 1)
        t_ns = records["t_ns"]
        inside = (t_ns >= fault.t_ns - BEFORE_NS) & (t_ns <= fault.t_ns + AFTER_NS)
        lines = "".join(json.dumps(event._asdict()) + "\n" for event in events)
        header = replace(
            header,
            title=f"{fault.fault}: {fault.text}",
            started_at=happened.isoformat(timespec="milliseconds"),
            start_ns=fault.t_ns,
            notes={**header.notes, "events": lines},
        )
        path = self.folder.new(happened, fault.fault)
        with TelemetryWriter(path, header, records.dtype) as writer:
            writer.append_events(events)
            writer.append(records[inside])
        self.folder.keep_newest(KEPT)
        return path
