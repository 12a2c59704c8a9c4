"""Recordings on request and around faults, of a stage whose loop may be exchanged."""

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

from numpy.typing import NDArray

from piezod.daemon import accepted_config
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.service.stage_service import BadValueError, NotNowError
from piezod.daemon.stores.flight_recorder import FlightRecorder
from piezod.daemon.stores.recorder import Recorder, RecorderError, RecordSource
from piezod.daemon.supervisor.connection import LoopConnection
from piezod.records.telemetry_header import TelemetryHeader
from piezod.telemetry.layout import enumerations, record_dtype
from piezod.telemetry.record import StageEvent

Document = dict[str, Any]

_log = logger("recorder")


class StageRecordings:
    """The recorder, the flight recorder, and what both say of the stage.

    Args:
        paths: Where the files go.
        axes: Number of axes.
        open_reader: Gives a reader that begins with the next cycle.
        last: Gives up to so many of the newest records.
        learned: Gives the weights that axes have now, by their names.
    """

    def __init__(
        self,
        paths: StagePaths,
        axes: int,
        open_reader: Callable[[], RecordSource],
        last: Callable[[int], NDArray[Any]],
        learned: Callable[[], Mapping[str, NDArray[Any]]],
    ) -> None:
        self._name = paths.name
        self._recorder = Recorder(open_reader, record_dtype(axes), paths.recordings, learned)
        self._flights = FlightRecorder(last, paths.flights)
        self._one_at_a_time = asyncio.Lock()

    @property
    def under_way(self) -> str:
        """The name of the recording that goes on; empty where none does."""
        status = self._recorder.status
        return status.name if status.recording else ""

    async def start(self, loop: LoopConnection, label: str | None) -> Document:
        """Start recording every cycle.

        Raises:
            BadValueError: If the label cannot be part of a name.
            NotNowError: If one goes on already, or there is no room.
        """
        async with self._one_at_a_time:
            header = self._header(loop, label or self._name)
            try:
                name = await asyncio.to_thread(self._recorder.start, header, label or "")
            except ValueError as error:
                raise BadValueError(str(error)) from error
            except RecorderError as error:
                raise NotNowError(str(error)) from error
        return {"name": name}

    async def stop(self) -> Document:
        """End the recording.

        Raises:
            NotNowError: If none goes on.
        """
        if not self.under_way:
            raise NotNowError("nothing is being recorded", "start a recording first")
        async with self._one_at_a_time:
            status = await asyncio.to_thread(self._recorder.stop)
        return status._asdict()

    async def list(self) -> tuple[Document | None, list[Document]]:
        """Return the recording that goes on, or None, and those that are finished."""
        status = self._recorder.status
        files = await asyncio.to_thread(self._recorder.folder.files)
        finished = [each._asdict() for each in files if each.name != self.under_way]
        return (status._asdict() if status.recording else None), finished

    def note(self, event: StageEvent) -> None:
        """Tell the flight recorder what happened."""
        self._flights.note(event)

    async def write_flight(self, loop: LoopConnection, *, at_once: bool = False) -> None:
        """Write what a fault wants to be kept, as soon as that is over, or at once."""
        write = self._flights.write_now if at_once else self._flights.write_due
        header = self._header(loop, self._name)
        try:
            path = await asyncio.to_thread(write, header, time.monotonic_ns())
        except OSError as error:
            _log.error("flight recorder failed", why=str(error))
            return
        if path is not None:
            _log.warning("flight recorded", file=str(path))

    async def close(self) -> None:
        """End the recording, if one goes on."""
        async with self._one_at_a_time:
            await asyncio.to_thread(self._recorder.stop)

    def _header(self, loop: LoopConnection, title: str) -> TelemetryHeader:
        places = enumerations().items()
        return TelemetryHeader(
            title=title,
            axes=loop.axes,
            rate_hz=loop.config.rate_hz,
            started_at=datetime.now(UTC).isoformat(timespec="milliseconds"),
            start_ns=time.monotonic_ns(),
            names={field: [str(each.value) for each in members] for field, members in places},
            notes={"configuration": json.dumps(accepted_config.document(loop.config))},
        )
