"""The stage as the HTTP service sees it: posts requests to the loop, reads the shared memory.

Only the service knows HTTP, roles and the lease. No method may block for more than a few
milliseconds unless it is `async`: all clients share one thread.
"""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from math import inf, isfinite
from pathlib import Path
from typing import Final

from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.config.transform import UserAxisConfig
from piezod.control.reference.motion import MotionLimits, motion_limits, moving_s
from piezod.control.stage.answer import Answer
from piezod.daemon import accepted_config
from piezod.daemon.logging import drops_lines, logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.stage import status as told
from piezod.daemon.stage.connection import FollowingReader, LoopConnection
from piezod.daemon.stage.errors import NotNowError, UnavailableError, UnknownNameError
from piezod.daemon.stage.metrics import StageFacts, metrics_text
from piezod.daemon.stage.parameters import LearnedParameters
from piezod.daemon.stage.peer import AuditEntry, Peer
from piezod.daemon.stage.recordings import StageRecordings
from piezod.daemon.stage.scanned import scanned_part
from piezod.daemon.stores.audit import AuditLog
from piezod.daemon.stores.audit_queue import AuditQueue
from piezod.daemon.stores.parameter_store import ParameterStore
from piezod.messages.answers import Faults, Health, Realtime, Status
from piezod.messages.documents import Document
from piezod.messages.endpoints import TOWARDS_SAFETY
from piezod.messages.recording_edge import RecordingEdge
from piezod.messages.requests import TABLE, AdoptModel, Arm, Estop, Request, Shutdown
from piezod.messages.stores import (
    Audit,
    History,
    KeptRecording,
    Loaded,
    Parameters,
    Recording,
    Recordings,
    Reloaded,
    Saved,
)
from piezod.telemetry.arrays import Records, RingReader
from piezod.telemetry.events import EventReader
from piezod.telemetry.learned import LearnedAxis
from piezod.telemetry.record import StageEvent

EXCHANGED_WITHIN_S: Final = 8.0
"""How long a request waits for the end of an exchange, in s; clients wait 10 s for an answer."""
RESCUER_WITHIN_S: Final = 8.0
"""How long arming waits for the rescuer, in s."""
_POLL_S: Final = 0.02

_log = logger("service")


class RunningStage:
    """A stage with its loop, recordings, parameters and audit.

    Args:
        paths: The files of the stage; their folders exist.
        loop: Connection to the loop, which need not run yet.
        stop: Called with the reason when a client requests a shutdown.
        reload: Called when a client requests a reload.
        shadow: Whether every arming is in shadow, so that nothing is written.
        config_changed: Returns whether the configuration file is another one than that in force;
            called in a thread, because it may wait for the disk.
        can_rescue: Returns whether the rescuer is ready; the stage is not armed without it.
    """

    def __init__(
        self,
        paths: StagePaths,
        loop: LoopConnection,
        *,
        stop: Callable[[str], None],
        reload: Callable[[Peer], Awaitable[Reloaded]],
        shadow: bool,
        config_changed: Callable[[], bool] = bool,
        can_rescue: Callable[[], bool] = lambda: True,
    ) -> None:
        self._played_file, self._scanned_files = paths.played, paths.scanned
        self.loop = loop
        """Connection to the loop; a reload replaces it."""
        self.available = True
        """Whether there is a loop for requests; False during an exchange."""
        self.parameters = LearnedParameters(ParameterStore(paths.parameters, paths.name))
        self.stage_recordings = StageRecordings(
            paths,
            axes=len(loop.axes),
            open_reader=self.open_reader,
            open_events=lambda: EventReader(self.loop.shared),
            last=self._last,
            learned=self._learned,
            models=lambda: self.loop.models,
        )
        self.stage_audit = AuditQueue(AuditLog(paths.audit))
        self._paths, self._stop, self._reload, self._shadow = paths, stop, reload, shadow
        self._config_changed, self._changed = config_changed, False
        self._can_rescue = can_rescue
        self._detections = dict.fromkeys(Fault, 0)

    @property
    def axes(self) -> Sequence[str]:
        """The names of the axes."""
        return self.loop.axes

    @property
    def places(self) -> Mapping[str, int]:
        """Place of each axis in a record, in the order for people."""
        return self.loop.places

    @property
    def recordings_folder(self) -> Path:
        """Folder of the recordings."""
        return self._paths.recordings

    async def request(self, request: Request, peer: Peer) -> Answer:
        """Send a request to the loop, and wait for its answer.

        The service has checked role and lease; `Reset.engineer` is set only for an engineer.

        Raises:
            UnavailableError: If there is no loop, or its mailbox is full.
            NoAnswerError: If it does not answer in time.
        """
        # Only the supervisor shuts down: a loop that ends without its request counts as lost.
        if isinstance(request, Shutdown):
            self._stop(f"requested by {peer.user}")
            return Answer(True)
        if isinstance(request, Arm):
            await self._rescuer_soon()
            request = Arm(shadow=True) if self._shadow else request
        if not self.available and TABLE[request.kind].access == TOWARDS_SAFETY:
            return Answer(True)  # an exchange drives nothing, and neither does the new loop
        loop = await self._running_soon(inf if isinstance(request, Estop) else EXCHANGED_WITHIN_S)
        if isinstance(request, AdoptModel):  # not while parameters are read or saved
            return await self.parameters.adopt(loop, request)
        return await loop.requests.ask(request)

    def stream_setpoint(self, setpoints_um: Mapping[str, float]) -> None:
        """Set the newest setpoint of a stream, in µm, for each axis in the mapping.

        Called after a `Stream` request for these axes was accepted, up to some thousand times per
        second.

        Raises:
            BadValueError: If a value is out of the command range of its axis; no axis is set then.
            NotNowError: If the stage no longer follows the stream.
            UnavailableError: If there is no loop.
        """
        self._running().stream_setpoint(setpoints_um)

    @property
    def state(self) -> State:
        """State in the newest cycle."""
        return told.state_of(self.loop.shared, self.loop.latest())

    def status(self) -> Status:
        """Return the status of the newest cycle, without lease and role."""
        loop, name = self.loop, self._paths.name
        newest = loop.newest(told.PATH if loop.config.user_axes else 1)
        return told.status(name, loop.config, loop.shared, newest, loop.learned)

    def health(self) -> Health:
        """Return whether the loop runs cycles, with the age of its last cycle."""
        # Before its first cycle a loop neither hangs nor is healthy.
        health, now_ns = self.loop.health, time.monotonic_ns()
        healthy = self.available and health.started and not health.hung(now_ns)
        return Health(healthy=healthy, cycle_age_s=health.age_s(now_ns))

    def faults(self) -> Faults:
        """Return the faults that are present or latched."""
        return Faults(faults=told.faults_of(self.loop.shared, self.loop.latest()))

    def fault_ids(self, mask: int) -> Sequence[str]:
        """Return the ids of the faults in a mask of a record."""
        return told.fault_ids(mask)

    def realtime(self) -> Realtime:
        """Return what the loop obtained from the operating system, and its counters."""
        return told.realtime(self.loop.config, self.loop.shared)

    def count_fault(self, event: StageEvent) -> None:
        """Count an event if it is the detection of a fault."""
        if event.kind == "fault":
            self._detections[Fault(event.fault)] += 1

    def metrics(self, *, lease_held: bool, openmetrics: bool) -> bytes:
        """Return the metrics as text; called in a thread.

        Args:
            lease_held: Whether a client has the lease.
            openmetrics: Whether as OpenMetrics; otherwise in the older text format of Prometheus.
        """
        health = self.health()
        recording = self.stage_recordings.status
        facts = StageFacts(
            self._paths.name,
            self.loop,
            health.healthy,
            health.cycle_age_s,
            self._detections,
            recording,
            lease_held,
        )
        return metrics_text(facts, openmetrics=openmetrics)

    def config(self) -> Document:
        """Return the configuration in force, with the positions that may be commanded.

        `longest_move_s` has for each axis how long a movement over all of them takes, in s;
        `user_axes` has the limits of the user axes, if there are any, with the keys of an axis.
        """
        loop = self.loop
        document, longest_s = accepted_config.document(loop.config), {}
        if users := loop.config.user_axes:
            document["user_axes"] = {name: _as_axis(user) for name, user in users.items()}
        for name, user in users.items():
            limits = MotionLimits(user.speed_per_s, 0.0, *user.range)
            longest_s[name] = moving_s(user.range[1] - user.range[0], limits)
        for name, axis in document["axes"].items():
            range_um = loop.range_um(name)
            if all(map(isfinite, range_um)):
                axis["command_range_um"] = list(range_um)
                limits = motion_limits(loop.config.axes[name], range_um, 1.0 / loop.config.rate_hz)
                longest_s[name] = moving_s(range_um[1] - range_um[0], limits)
        return {**document, "longest_move_s": longest_s}

    async def reload(self, peer: Peer) -> Reloaded:
        """Read the configuration again; exchange all of it, or keep the present one.

        Raises:
            BadValueError: If the file is not valid; the text lists every problem.
            NotNowError: If the present state does not allow it.
        """
        return await self._reload(peer)

    def open_reader(self) -> FollowingReader:
        """Return a new reader of the ring; it begins with the next record."""
        return FollowingReader(lambda: self.loop.shared)

    async def params(self) -> Parameters:
        """Return the parameters that the loop uses now."""
        return await self.parameters.now(self.loop)

    async def params_history(self) -> History:
        """Return the saved parameters, newest first."""
        return await self.parameters.history()

    async def save_params(self, peer: Peer) -> Saved:
        """Save the parameters in use."""
        return await self.parameters.save(self._running(), peer.user)

    async def load_params(self, sequence: int | None, peer: Peer) -> Loaded:
        """Load saved parameters into the loop; the newest if there is no number.

        Raises:
            UnknownNameError: If no parameters have that number.
            NotNowError: If the loop does not accept them now, or they are of another stage.
        """
        loaded = await self.parameters.load(self._running(), sequence)
        _log.info("parameters loaded", user=peer.user, sequence=loaded.sequence)
        return loaded

    async def restore_params(self) -> list[str]:
        """Restore the parameters of a loop that has just started; return what has been lost."""
        return await self.parameters.restore(self._running())

    def report_faults(self) -> None:
        """Report the faults of this process to the loop, which shows them with its own."""
        record = self.loop.latest()
        if record is not None and Fault.D8 in self.fault_ids(told.masks(record)[1]):
            self.parameters.rejected = False  # latched: the loop knows it
        found = {
            Fault.D8: self.parameters.rejected,
            Fault.P6: self.stage_recordings.disk_full,
            Fault.P7: self.stage_recordings.take_lost(),
            Fault.P11: self._changed,
            Fault.P15: drops_lines(),
        }
        self.loop.report([fault for fault, is_there in found.items() if is_there])

    async def look_at_config(self) -> None:
        """Look whether the configuration file has changed, for the next report of faults."""
        self._changed = await asyncio.to_thread(self._config_changed)

    async def start_recording(
        self,
        label: str | None,
        peer: Peer,
        *,
        start_s: float | None = None,
        edge: RecordingEdge | None = None,
    ) -> Recording:
        """Start recording every cycle, from an instant or from an edge on."""
        started = await self.stage_recordings.start(self._running(), label, start_s, edge)
        _log.info("recording started", user=peer.user, name=started.name)
        return started

    async def stop_recording(self, peer: Peer) -> Recording:
        """End the recording and close its file."""
        ended = await self.stage_recordings.stop()
        _log.info("recording stopped", user=peer.user, name=ended.name)
        return ended

    async def recordings(self) -> Recordings:
        """Return the running recording, the finished ones, and their folder."""
        return await self.stage_recordings.list()

    async def keep_recording(self, name: str, peer: Peer, *, kept: bool) -> KeptRecording:
        """Mark a recording as kept, or remove the mark."""
        answer = await self.stage_recordings.keep(name, kept=kept)
        _log.info("recording kept" if kept else "recording not kept", user=peer.user, name=name)
        return answer

    def audit(self, entry: AuditEntry) -> None:
        """Write a request and its answer to the audit log."""
        peer = entry.peer
        self.stage_audit.write(
            peer.uid, peer.user, peer.client, entry.what, entry.accepted, entry.why
        )

    async def played(self) -> Document:
        """Return the record of the last play."""
        try:
            text = await asyncio.to_thread(self._played_file.read_text, encoding="utf-8")
        except FileNotFoundError:
            what = "nothing was played since this machine started"
            raise UnknownNameError(what, "`piezod play` plays a table") from None
        document: Document = json.loads(text)
        return document

    async def scanned(self, first: int) -> Document:
        """Return the last scan, with the samples of some sweeps from this one on."""
        return await asyncio.to_thread(scanned_part, *self._scanned_files, first)

    async def audit_log(self, limit: int) -> Audit:
        """Return the newest entries of the audit log, newest first."""
        return Audit(audit=await asyncio.to_thread(self.stage_audit.last, limit))

    def _last(self, count: int) -> Records:
        return RingReader(self.loop.shared).last(count)

    def _learned(self) -> dict[str, LearnedAxis]:
        learned = {name: self.loop.learned.read(i) for i, name in enumerate(self.loop.axes)}
        return {name: axis for name, axis in learned.items() if axis is not None}

    async def _rescuer_soon(self) -> None:
        """Wait until the rescuer is ready.

        Raises:
            NotNowError: If it is not in time.
        """
        end_s = time.monotonic() + RESCUER_WITHIN_S
        while not self._can_rescue():
            if time.monotonic() > end_s:
                what = "nobody could ramp the stage down if its loop failed: the rescuer is missing"
                raise NotNowError(what, "the log says why; restart the daemon")
            await asyncio.sleep(_POLL_S)

    async def _running_soon(self, within_s: float) -> LoopConnection:
        """Return the loop; wait for the end of an exchange, at most this time."""
        end_s = time.monotonic() + within_s
        while not self.available and time.monotonic() < end_s:
            await asyncio.sleep(_POLL_S)
        return self._running()

    def _running(self) -> LoopConnection:
        if not self.available:
            raise UnavailableError("the loop is being exchanged or stopped", "try again soon")
        return self.loop


def _as_axis(user: UserAxisConfig) -> Document:
    """Return the limits of a user axis with the keys of an axis; numbers are in its unit."""
    return {
        "unit": user.unit,
        "command_range_um": list(user.range),
        "speed_um_per_s": user.speed_per_s,
        "on_target": {"tolerance_um": user.tolerance, "settle_s": user.settle_s},
    }
