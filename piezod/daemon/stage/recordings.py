"""Recordings on request and flight records of a stage, across exchanges of its loop."""

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from functools import lru_cache, partial
from math import inf

from piezod.config.daemon import RecordingsConfig
from piezod.config.model_file import ModelFile, dump_model
from piezod.control.stage.common_start import start_ns, start_refusal
from piezod.daemon import accepted_config
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.stage.errors import BadValueError, NotNowError, UnknownNameError
from piezod.daemon.stores.edge_source import Trigger
from piezod.daemon.stores.flight_recorder import FlightRecorder
from piezod.daemon.stores.recorded_files import EventSource, RecordedStage, RecordSource
from piezod.daemon.stores.recorder import Recorder, RecorderError
from piezod.daemon.stores.recording_limits import RecordingLimits
from piezod.errors import DataError
from piezod.messages.recording_edge import RecordingEdge
from piezod.messages.stores import KeptRecording, Recording, Recordings, RunningRecording
from piezod.records.recording.header import TelemetryHeader
from piezod.records.recording.part_names import part_name
from piezod.records.repair import repair
from piezod.telemetry.arrays import Records, record_dtype
from piezod.telemetry.descriptions import descriptions, mask_bits
from piezod.telemetry.layout import enumerations
from piezod.telemetry.learned import LearnedAxis
from piezod.telemetry.record import StageEvent
from piezod.units import NS_PER_S, to_ascii

_log = logger("recorder")

_model_text = lru_cache(maxsize=16)(dump_model)
"""The text of a model file; cached because it takes longer than the rest of a header."""


class StageRecordings:
    """The recorder and the flight recorder of a stage.

    Args:
        paths: The files of the stage.
        axes: Number of axes.
        open_reader: Returns a reader that begins with the next record.
        open_events: Returns a reader that begins with the next event.
        last: Returns the newest records, at most a given number.
        learned: Returns the present parameters of the axes, by name.
        models: Returns the models in use, by axis.
    """

    def __init__(
        self,
        paths: StagePaths,
        *,
        axes: int,
        open_reader: Callable[[], RecordSource],
        open_events: Callable[[], EventSource],
        last: Callable[[int], Records],
        learned: Callable[[], Mapping[str, LearnedAxis]],
        models: Callable[[], Mapping[str, ModelFile | None]],
    ) -> None:
        self._name, self.folder = paths.name, paths.recordings
        # Now, because they are read from the source, which an upgrade may take away.
        self._descriptions = descriptions()
        stage = RecordedStage(
            open_reader,
            open_events,
            partial(record_dtype, axes),
            learned,
            lambda: _texts(models()),
            last,
        )
        self._recorder = Recorder(stage, paths.recordings)
        self._flights = FlightRecorder(last, paths.flights)
        self._lost_before = ("", 0)
        self._one_at_a_time = asyncio.Lock()  # `Recorder.start` and `stop` must not overlap

    @property
    def status(self) -> Recording:
        """Status of the running or the last recording."""
        return self._recorder.status

    @property
    def running_name(self) -> str:
        """Name of the running recording; empty if there is none."""
        status = self._recorder.status
        return status.name if status.recording else ""

    @property
    def disk_full(self) -> bool:
        """Whether the disk was too full for the last recording, and no client knows that yet."""
        return self._recorder.status.disk_full

    def take_lost(self) -> bool:
        """Return whether the recording has lost cycles since the last call: the disk is slow."""
        status = self._recorder.status
        before, self._lost_before = self._lost_before, (status.name, status.lost)
        return status.lost > (before[1] if before[0] == status.name else 0)

    async def start(
        self,
        loop: LoopConnection,
        label: str | None,
        start_s: float | None = None,
        edge: RecordingEdge | None = None,
    ) -> Recording:
        """Start recording every cycle, or wait for an edge.

        Args:
            loop: The loop.
            label: Part of the name.
            start_s: Instant of the first record and of time 0; None for now.
            edge: The edge that starts it; None to start without one.

        Raises:
            BadValueError: If the label cannot be part of a name, the instant cannot be kept, or the
                stage has no such line.
            NotNowError: If a recording is running already, or the disk is too full.
        """
        if why := start_refusal(start_s, time.monotonic_ns(), 0.0):
            raise BadValueError(why)
        begins_ns, trigger = start_ns(start_s), None if edge is None else _trigger_of(edge, loop)
        async with self._one_at_a_time:
            header = self._header(loop, label or self._name, begins_ns)
            limits = _limits(loop.config.recordings)
            start = partial(self._recorder.start, header, label or "", limits, begins_ns, trigger)
            try:
                name = await asyncio.to_thread(start)
            except ValueError as error:
                raise BadValueError(str(error)) from error
            except RecorderError as error:
                raise NotNowError(str(error)) from error
            late_s = (time.monotonic_ns() - begins_ns) / NS_PER_S
            if begins_ns and late_s > 0.0:  # its first cycles are missing
                await asyncio.to_thread(self._recorder.stop)
                what = f"the file was ready {late_s:.3g} s after start_s"
                raise NotNowError(what, "start later; the first recording takes longest")
        return Recording(True, name, armed=trigger is not None)

    async def stop(self) -> Recording:
        """End the recording, or return that it has ended by itself, and why.

        Raises:
            NotNowError: If there is none.
        """
        if not self.running_name and not self._recorder.status.why:
            raise NotNowError("nothing is being recorded", "start a recording first")
        async with self._one_at_a_time:
            return await asyncio.to_thread(self._recorder.stop)

    async def list(self) -> Recordings:
        """Return the running recording, the finished ones, and their folder."""
        status = self._recorder.status
        running = None
        if status.recording:
            running = RunningRecording(**vars(status), file=part_name(status.name, status.files))
        files = await asyncio.to_thread(self._recorder.folder.files)
        finished = tuple(each for each in files if running is None or each.name != running.file)
        return Recordings(running=running, recordings=finished, folder=str(self.folder))

    async def keep(self, name: str, *, kept: bool) -> KeptRecording:
        """Mark a recording as kept, or remove the mark.

        Raises:
            UnknownNameError: If there is none of that name.
            NotNowError: If the disk refuses the mark.
        """
        try:
            found = await asyncio.to_thread(self._recorder.folder.keep, name, kept)
        except OSError as error:
            raise NotNowError(f"the mark was not changed: {error}", "look at the disk") from error
        if not found:
            what = f"no recording {name[:100]!r}"
            raise UnknownNameError(what, "`piezod record list` shows them")
        return KeptRecording(name, kept)

    async def repair(self) -> None:
        """Make the files of a daemon that was killed open plainly; call it before all else."""
        async with self._one_at_a_time:
            await asyncio.to_thread(self._repair)

    def _repair(self) -> None:
        for folder in (self._recorder.folder, self._flights.folder):
            for each in folder.files():
                path = folder.path_of(each.name)
                try:
                    if repair(path):
                        _log.warning("recording was not closed: repaired", file=str(path))
                except (DataError, OSError) as error:
                    _log.error("recording not repaired", why=str(error))

    def take_event(self, event: StageEvent) -> None:
        """Pass an event to the flight recorder, which a fault triggers."""
        self._flights.take_event(event)

    async def write_flight(self, loop: LoopConnection, *, at_once: bool = False) -> None:
        """Write the flight record of a fault when its time is over, or at once."""
        now_ns = time.monotonic_ns()
        # First: to make a header costs a millisecond, and this is called twice a second.
        if not at_once and not self._flights.is_due(now_ns):
            return
        header = self._header(loop, self._name)
        try:
            path = await asyncio.to_thread(self._flights.write_now, header, now_ns)
        except OSError as error:  # a full disk must not end the housekeeping
            _log.error("flight recorder failed", why=str(error))
            return
        if path is not None:
            _log.warning("flight recorded", file=str(path))

    async def close(self) -> None:
        """End the recording, if there is one."""
        async with self._one_at_a_time:
            await asyncio.to_thread(self._recorder.stop)

    def _header(self, loop: LoopConnection, title: str, begins_ns: int = 0) -> TelemetryHeader:
        now_ns = time.monotonic_ns()
        ahead = timedelta(microseconds=max(begins_ns - now_ns, 0) / 1000)
        # Recordings store members of enumerations as numbers; the header has their names.
        places = enumerations().items()
        models = {f"model_{axis}": text for axis, text in _texts(loop.models).items()}
        lines = tuple(loop.config.lines)
        return TelemetryHeader(
            title=title,
            axes=loop.axes,
            rate_hz=loop.config.rate_hz,
            started_at=(datetime.now(UTC) + ahead).isoformat(timespec="milliseconds"),
            start_ns=begins_ns or now_ns,
            names={field: [str(each.value) for each in members] for field, members in places},
            notes={"configuration": json.dumps(accepted_config.document(loop.config)), **models},
            descriptions=self._descriptions,
            units={
                name: to_ascii(axis.unit)
                for name, axis in loop.config.user_axes.items()
                if axis.unit != "µm"
            },
            bits=mask_bits() | ({"lines": lines} if lines else {}),
        )


def _trigger_of(edge: RecordingEdge, loop: LoopConnection) -> Trigger:
    names = list(loop.config.lines)
    if edge.line not in names:
        what = f"no line {edge.line!r}: the stage has {', '.join(names) or 'none'}"
        remedy = "name a digital input of a device in `lines:` of its configuration"
        raise BadValueError(f"{what}; {remedy}")
    return Trigger(edge.line, names.index(edge.line), edge.before_s, edge.duration_s)


def _texts(models: Mapping[str, ModelFile | None]) -> dict[str, str]:
    return {axis: _model_text(model) for axis, model in models.items() if model}


def _limits(config: RecordingsConfig) -> RecordingLimits:
    mb = 1_000_000
    return RecordingLimits(
        inf if config.max_file_s is None else config.max_file_s,
        inf if config.max_file_mb is None else mb * config.max_file_mb,
        inf if config.max_total_mb is None else mb * config.max_total_mb,
    )
