"""The supervisor: owns the lock of a stage, starts the loop process, and answers for both.

It has no handle of a device. Everything runs in one event loop: `_watch` checks the loop process in
each period and reports its health to systemd. If the loop process is lost, the run ends, and the
rescuer ramps the stage down.
"""

import asyncio
import os
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Final

from piezod.config.faults import Fault
from piezod.config.states import State
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.service.access import GroupRoles
from piezod.daemon.service.app import create_app
from piezod.daemon.stage.errors import NotNowError, StageError
from piezod.daemon.stage.peer import Peer
from piezod.daemon.stage.running_stage import RunningStage
from piezod.daemon.supervisor.api_server import ApiServer
from piezod.daemon.supervisor.compiling import CompilingReport
from piezod.daemon.supervisor.heartbeat import Heartbeat
from piezod.daemon.supervisor.housekeeping import Housekeeping
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.notify import Notifier
from piezod.daemon.supervisor.reload import (
    AT_REST,
    changes,
    exchange,
    kept_axes,
    prepare,
)
from piezod.daemon.supervisor.signals import Signals
from piezod.daemon.supervisor.terms import Ending, RunOptions
from piezod.messages.endpoints import Role
from piezod.messages.stores import Reloaded

PERIOD_S: Final = 0.1
"""Period of `_watch`, in s."""

_ACCEPTS_PARAMS: Final = frozenset({State.SAFE, State.FAULT})
"""States in which a loop accepts other parameters."""

_RESTORED_WITHIN_S: Final = 5.0
"""How long the answer to a reload waits until the new loop has its parameters, in s."""

_log = logger("supervisor")


class Supervisor:
    """Runs a stage until a shutdown is requested or the loop is lost.

    Args:
        source: The configuration file; a reload reads it again.
        paths: The files of the stage; its lock is held.
        run: The loop process, which has accepted the configuration.
        options: Options of the command line.
        notifier: Reports to the service manager.
        signals: The signals that were received.

    Attributes:
        loop_run: The present run of the loop process; a reload replaces it.
        loop_hung: Whether it was killed because it ran no cycles any more.
    """

    def __init__(
        self,
        source: Path,
        paths: StagePaths,
        run: LoopRun,
        options: RunOptions,
        notifier: Notifier,
        signals: Signals,
    ) -> None:
        self._source, self._paths, self._options = source, paths, options
        self._notifier, self._signals = notifier, signals
        self._ending, self._compiling = Ending.IN_ORDER, CompilingReport(notifier)
        self._stopping = self._ready = self._reloading = self._exchanging = False
        self._state: State | None = None
        self.loop_run, self.loop_hung = run, False
        self._link = RunningStage(
            paths,
            self.loop_run.loop,
            stop=self.stop,
            reload=self.reload,
            shadow=options.shadow,
            config_changed=self._config_changed,
            can_rescue=lambda: self.loop_run.rescuer.ready,
        )
        self._heartbeat = Heartbeat(self.loop_run.loop)
        self._housekeeping = Housekeeping(self._link)
        self._api = ApiServer(
            create_app(self._link, GroupRoles(os.getuid(), time.monotonic)), paths
        )
        self._tasks: set[asyncio.Task[object]] = set()
        self._restored: LoopRun | None = None
        self._restoring: asyncio.Task[list[str]] | None = None

    async def run(self, *, last_end: int) -> Ending:
        """Run until the end; then the loop process has ended, or no longer gets a beat.

        Args:
            last_end: How the daemon ended last time: a value of `Word.UNCLEAN`.
        """
        # The socket first: if it cannot be bound, no device has been touched.
        await self._api.start()
        self.loop_run.start(last_end=last_end)
        housekeeping = asyncio.create_task(self._housekeeping.run())
        self._heartbeat.start()
        try:
            return await self._watch()
        finally:
            self._heartbeat.stop()  # a loop that still runs then ramps down
            housekeeping.cancel()

    async def close(self) -> None:
        """Write and close everything; call it after `run`."""
        await self._api.stop()
        await self._housekeeping.close()

    def stop(self, why: str) -> None:
        """Request a shutdown: the loop ramps down and ends. A second call does nothing."""
        if not self._stopping:
            self._stopping = True
            self._notifier.stopping(f"ramping down: {why}")
            _log.info("stopping", why=why)

    async def _watch(self) -> Ending:
        while True:
            now_ns = time.monotonic_ns()
            run = self.loop_run
            self._heartbeat.tick(now_ns)
            self._handle_signals()
            healthy = run.loop.health.update(now_ns)
            # During an exchange no loop may be running, which is no reason for the watchdog.
            if healthy or self._exchanging:
                self._notifier.alive()
            # Before the exit code: the last events may have the reason of an end.
            self._housekeeping.log_events()
            if not self._exchanging:
                run.rescuer.keep()
                self._report_state(run, healthy=healthy)
                if run.exit_code is not None:
                    return self._ended(run.exit_code)
                self._end_if_due(run, now_ns)
            await asyncio.sleep(PERIOD_S)

    def _end_if_due(self, run: LoopRun, now_ns: int) -> None:
        """Ask the loop to end if that was requested; kill it if it does not answer any more."""
        if self._stopping and not run.takes_requests:
            run.kill()  # it has not touched a device yet
            return
        if run.loop.health.hung(now_ns):
            self.loop_hung = True
            _log.error("loop killed", what="it runs no cycles any more", fault=Fault.L3)
        elif self._stopping and not run.request_end():
            _log.error("loop killed", what="it did not end in time")
        else:
            return
        self._ending = Ending.LOST
        run.kill()

    def _ended(self, code: int) -> Ending:
        """Return how the run ended, from the exit code of the loop process."""
        if self._stopping and not self.loop_run.takes_requests:
            return self._ending  # it was killed before it touched a device
        if not self._stopping or code != 0:
            _log.error("loop gone", code=code, what="the rescuer takes over")
            # From here on systemd applies its stop time-out; the watchdog would end the ramp.
            self._notifier.stopping("ramping down: the loop is gone")
            return Ending.LOST
        if self._ending is not Ending.LOST and not self.loop_run.loop.ended_at_safe_voltage():
            _log.error("not at the safe voltage", what="the rescuer takes over")
            return Ending.UNSAFE
        return self._ending

    def _report_state(self, run: LoopRun, *, healthy: bool) -> None:
        """Report readiness and state to the service manager."""
        # A loop that waits for an absent device is healthy: the service is ready in BLIND too.
        if healthy and not self._ready:
            self._ready = True
            self._notifier.ready(run.loop.state.value)
            _log.info("ready", stage=self._paths.name, socket=str(self._paths.api_socket))
            if self._options.require_device and not run.loop.devices_opened:
                self._ending = Ending.ABSENT
                self.stop("a device is absent")
        if not self._stopping:
            self._compiling.update(run)
            self._restore_params(run)
        if run.loop.state is not self._state and not self._stopping:
            self._state = run.loop.state
            self._notifier.status(self._state.value)

    def _restore_params(self, run: LoopRun) -> None:
        """Let each new loop begin with its parameters, when it has its devices."""
        if (
            run is not self._restored
            and run.loop.devices_opened
            and run.loop.state in _ACCEPTS_PARAMS
        ):
            self._restored = run
            self._restoring = asyncio.create_task(self._link.restore_params())

    def _run_beside(self, what: Coroutine[object, object, object]) -> None:
        task = asyncio.create_task(what)
        self._tasks.add(task)  # the event loop keeps only a weak reference
        task.add_done_callback(self._tasks.discard)

    async def reload(self, peer: Peer) -> Reloaded:
        """Read the configuration again; if it has changed, exchange the loop.

        Latched faults, the identities of the devices and the learned parameters go on, as far as
        the new configuration is about the same devices and models.

        Returns:
            The changed values (`changes`), and what has been lost of the parameters (`lost`).

        Raises:
            BadValueError: If the configuration is not valid.
            NotNowError: If it cannot be exchanged now.
        """
        self._check_exchange()
        if self._reloading:
            raise NotNowError("another reload is in progress", "wait for its end")
        self._reloading = True
        try:
            different = await self._reload(peer)
        finally:
            self._reloading = False
        lost = await self._lost_parameters() if different else []
        return Reloaded(tuple(different), tuple(lost))

    async def _reload(self, peer: Peer) -> list[str]:
        run, strict_rt = self.loop_run, self._options.strict_rt
        fresh = await prepare(run, self._paths, self._source, strict_rt=strict_rt)
        different = changes(run, fresh)
        try:
            self._check_exchange()  # again: the state may have changed meanwhile
        except NotNowError:
            fresh.discard()
            raise
        _log.info("reload", user=peer.user, changes=different)
        if not different:
            run.source_files = fresh.source_files  # they may have other comments now
            fresh.discard()
            return []
        await self._link.parameters.keep(run.loop, kept_axes(run.config, different))
        # From here on the end of a loop is not taken for a loss.
        self._exchanging, self._link.available = True, False
        try:
            started = await exchange(run, self._paths, fresh, self._use)
        finally:
            self._exchanging, self._link.available = False, True
        if not started:
            _log.error("reload failed", what="the old configuration is in force")
            what = "the loop did not start with the new configuration; the old one is in force"
            raise NotNowError(what, "the log says why")
        return different

    async def _lost_parameters(self) -> list[str]:
        """Return what the loop lost of its parameters; wait for them if it has its devices."""
        run, now_s = self.loop_run, asyncio.get_running_loop().time
        end_s = now_s() + _RESTORED_WITHIN_S
        while self._restored is not run and run.loop.devices_opened and now_s() < end_s:
            await asyncio.sleep(PERIOD_S)
        return await self._restoring if self._restored is run and self._restoring else []

    def _check_exchange(self) -> None:
        state = self.loop_run.loop.state
        if self._stopping or self._exchanging:
            raise NotNowError("the loop is being exchanged or stopped", "try again later")
        if state not in AT_REST:
            raise NotNowError(f"not in state {state}", "disarm first")
        if state is State.BLIND and self.loop_run.loop.devices_opened:
            what = "the amplifier was lost, and its voltage is unknown"
            raise NotNowError(what, "wait until it answers again, or restart the daemon")
        # The header of a recording has one configuration for all its records.
        if name := self._link.stage_recordings.running_name:
            raise NotNowError(f"recording {name} is running", "stop it first")

    def _use(self, run: LoopRun) -> None:
        self.loop_run, self._link.loop = run, run.loop
        self._heartbeat.beat_for(run.loop)

    def _config_changed(self) -> bool:
        return self.loop_run.source_files.changed()

    def _handle_signals(self) -> None:
        if self._signals.end:
            self.stop(self._signals.end)
        if self._signals.take_reload():  # SIGHUP, sent by `systemctl reload`
            self._run_beside(self._reload_for_manager())

    async def _reload_for_manager(self) -> None:
        self._notifier.reloading()
        try:
            await self.reload(Peer(os.getuid(), os.getpid(), "SIGHUP", "", Role.ENGINEER))
        except StageError as error:
            _log.error("reload refused", why=str(error))
        self._notifier.ready(self.loop_run.loop.state.value)  # systemd waits for it in any case
