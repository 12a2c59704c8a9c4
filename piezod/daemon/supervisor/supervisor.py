"""The supervisor: owns the lock of a stage, starts the loop process, and answers for both.

It has no handle of a device. Everything happens in one event loop, looked after by `_watch`: the
loop process hears that we live, through `heart.Heart`; systemd hears that the loop is healthy, and
a loop that is gone is replaced by `piezod safe`.
"""

import asyncio
import os
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Final

from piezod.config.endpoints import Role
from piezod.config.states import State
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.service.app import create_app
from piezod.daemon.service.roles import GroupRoles
from piezod.daemon.service.stage_service import Document, NotNowError, Peer, StageError
from piezod.daemon.supervisor.api_server import Api
from piezod.daemon.supervisor.heart import Heart
from piezod.daemon.supervisor.housekeeping import Housekeeping
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.notify import Notifier
from piezod.daemon.supervisor.reload import AT_REST, changes, exchange, prepare
from piezod.daemon.supervisor.signals import Signals
from piezod.daemon.supervisor.stage_link import StageLink
from piezod.daemon.supervisor.terms import Ending, RunOptions

TICK_S: Final = 0.1
"""How often everything is looked after; the loop takes a supervisor for dead after 1 s."""

_ADOPTING: Final = frozenset({State.SAFE, State.FAULT})
"""States in which a loop takes other parameters."""

_log = logger("supervisor")


class Supervisor:
    """Runs a stage until it is told to stop or the loop is gone.

    Args:
        source: The configuration file, read again by a reload.
        paths: The files of the stage; its lock is held.
        run: The loop process, which has accepted the configuration.
        options: What the command line adds.
        notifier: The way to the service manager.
        signals: What signals have asked for, and will.
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
        self._ending = Ending.IN_ORDER
        self._stopping = self._ready = self._exchanging = False
        self._state: State | None = None
        self.run_of_loop = run
        self._link = StageLink(
            paths,
            self.run_of_loop.loop,
            stop=self.stop,
            reload=self.reload,
            shadow=options.shadow,
        )
        self._heart = Heart(self.run_of_loop.loop)
        self._house = Housekeeping(self._link)
        self._api = Api(
            create_app(self._link, GroupRoles(os.getuid(), time.monotonic)), paths.api_socket
        )
        self._tasks: set[asyncio.Task[object]] = set()
        self._taken_up: LoopRun | None = None

    async def run(self, *, unclean: bool) -> Ending:
        """Run until the end; the loop process has ended then, or hears no more of us.

        Args:
            unclean: Whether the daemon did not end in order last time.
        """
        await self._api.start()
        self.run_of_loop.start(unclean=unclean)
        housekeeping = asyncio.create_task(self._house.run())
        self._heart.start()
        try:
            return await self._watch()
        finally:
            self._heart.stop()
            housekeeping.cancel()

    async def close(self) -> None:
        """Write out and close everything; after `run`."""
        await self._api.stop()
        await self._house.close()

    def stop(self, why: str) -> None:
        """Have the loop ramp down and end, then end; again it does nothing."""
        if not self._stopping:
            self._stopping = True
            self._notifier.stopping(f"ramping down: {why}")
            _log.info("stopping", why=why)

    async def _watch(self) -> Ending:
        while True:
            now_ns = time.monotonic_ns()
            run = self.run_of_loop
            self._heart.tick(now_ns)
            self._heed_signals()
            healthy = run.loop.health.look(now_ns)
            if healthy or self._exchanging:
                self._notifier.alive()
            self._house.log_events()
            if not self._exchanging:
                self._note_state(run, healthy=healthy)
                if run.exit_code is not None:
                    return self._ended(run.exit_code)
                self._see_to_its_end(run, now_ns)
            await asyncio.sleep(TICK_S)

    def _see_to_its_end(self, run: LoopRun, now_ns: int) -> None:
        """Ask the loop to end where it shall, and kill it where it does not answer any more."""
        if self._stopping and not run.begun:
            run.kill()  # it starts, and has touched nothing
            return
        overdue = self._stopping and not run.ask_to_end()
        if overdue or run.loop.health.hung(now_ns):
            what = "it did not end in time" if overdue else "it runs no cycles any more"
            _log.error("loop killed", what=what)
            self._ending = Ending.LOST
            run.kill()

    def _ended(self, code: int) -> Ending:
        if self._stopping and not self.run_of_loop.begun:
            return self._ending
        if not self._stopping or code != 0:
            _log.error("loop gone", code=code, what="piezod safe takes over")
            # The watchdog would end us, and the ramp with us: from now on another timeout counts.
            self._notifier.stopping("ramping down: the loop is gone")
            return Ending.LOST
        if self._ending is not Ending.LOST and not self.run_of_loop.loop.left_safe():
            _log.error("not at the safe voltage", what="piezod safe takes over")
            return Ending.UNSAFE
        return self._ending

    def _note_state(self, run: LoopRun, *, healthy: bool) -> None:
        if healthy and not self._ready:
            self._ready = True
            self._notifier.ready(run.loop.state.value)
            _log.info("ready", stage=self._paths.name, socket=str(self._paths.api_socket))
            if self._options.require_device and not run.loop.opened:
                self._ending = Ending.ABSENT
                self.stop("a device is absent")
        if not self._stopping:
            self._take_up_params(run)
        if run.loop.state is not self._state and not self._stopping:
            self._state = run.loop.state
            self._notifier.status(self._state.value)

    def _take_up_params(self, run: LoopRun) -> None:
        """Have each loop begin with the parameters that were saved, once it has its devices."""
        if run is not self._taken_up and run.loop.opened and run.loop.state in _ADOPTING:
            self._taken_up = run
            self._do(self._link.take_up_params())

    def _do(self, what: Coroutine[object, object, object]) -> None:
        task = asyncio.create_task(what)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def reload(self, peer: Peer) -> Document:
        """Read the configuration again; swap it where nothing is driven, or keep the old one.

        Raises:
            BadValueError: If it is not valid.
            NotNowError: If it cannot be swapped now.
        """
        run, strict_rt = self.run_of_loop, self._options.strict_rt
        self._check_exchange()
        fresh = await prepare(run, self._paths, self._source, strict_rt=strict_rt)
        different = changes(run, fresh)
        try:
            self._check_exchange()  # again: that took a while
        except NotNowError:
            fresh.discard()
            raise
        _log.info("reload", user=peer.user, changes=different)
        self._exchanging, self._link.available = True, False
        try:
            came_up = await exchange(run, self._paths, fresh, self._use)
        finally:
            self._exchanging, self._link.available = False, True
        if not came_up:
            _log.error("reload failed", what="the configuration before is in force")
            what = "the loop did not come up with the new configuration; the one before is in force"
            raise NotNowError(what, "the log says why")
        return {"changes": different}

    def _check_exchange(self) -> None:
        state = self.run_of_loop.loop.state
        if self._stopping or self._exchanging:
            raise NotNowError("the loop is being exchanged or stopped", "try again later")
        if state not in AT_REST:
            raise NotNowError(f"not in state {state}", "disarm first")
        if name := self._link.recordings_of_stage.under_way:
            raise NotNowError(f"recording {name} goes on", "stop it first")

    def _use(self, run: LoopRun) -> None:
        self.run_of_loop, self._link.loop = run, run.loop
        self._heart.beat_for(run.loop)

    def _heed_signals(self) -> None:
        if self._signals.end:
            self.stop(self._signals.end)
        if self._signals.take_reload():  # what `systemctl reload` asks for
            self._do(self._reload_for_manager())

    async def _reload_for_manager(self) -> None:
        self._notifier.reloading()
        try:
            await self.reload(Peer(os.getuid(), os.getpid(), "SIGHUP", "", Role.ENGINEER))
        except StageError as error:
            _log.error("reload refused", why=str(error))
        self._notifier.ready(self.run_of_loop.loop.state.value)
