"""A machine in one process: the supervisor as it is, its loop in virtual time, one rig.

Replaced are the clocks, the start of a process, and the thread of the heartbeat. Everything else
is the daemon's code: `run_stage`, the service on its socket, the shared memory, the loop, its
devices, `piezod safe`, and all files.
"""

import asyncio
import gc
from collections.abc import Callable, Coroutine, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, suppress
from functools import partial
from math import inf
from os import getpid
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TextIO, TypeVar
from unittest.mock import patch

from piezod.config.daemon import DaemonConfig
from piezod.control.assembly import make_stage
from piezod.control.controller import StageController
from piezod.control.warm_up import warm_up
from piezod.control.watch.loop import LoopWatch
from piezod.daemon import accepted_config
from piezod.daemon.last_output import LastOutputReader, LastOutputWriter
from piezod.daemon.lock import Lock, device_lock
from piezod.daemon.logging import EventRateLimit
from piezod.daemon.loop.accept import load
from piezod.daemon.loop.loop import Loop
from piezod.daemon.loop.pacer import Pacer
from piezod.daemon.loop.play_thread import play_threads
from piezod.daemon.loop.process import take_over
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.daemon.paths import PLAYED, StagePaths, stage_paths
from piezod.daemon.safe.ramp_down import Noted, ramp_down
from piezod.daemon.safe.rescue import note_outcomes
from piezod.daemon.service.app import create_app
from piezod.daemon.supervisor.heartbeat import BEAT_S, Heartbeat
from piezod.daemon.supervisor.loop_run import LoopRun
from piezod.daemon.supervisor.run import run_stage
from piezod.daemon.supervisor.signals import Signals
from piezod.daemon.supervisor.source_files import SourceFiles
from piezod.daemon.supervisor.terms import RunOptions
from piezod.devices.channels import Channels
from piezod.devices.wiring import pairs_of
from piezod.errors import StillDrivenError
from piezod.telemetry import requests_codec
from piezod.telemetry.record import CycleRecord
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S
from tests.daemon.fake_rescuer import FakeRescuer
from tests.soak.lock_step import LockStep, SteppedPlay
from tests.soak.rig import CheckedRig
from tests.soak.virtual_time import AtOnce, VirtualClock, run_virtually

T = TypeVar("T")
KILLED = -9
WAIT_FOR_SAFE_S = 10.0


class Machine:
    """Runs a stage again and again, with the same rig and the same files.

    The path of its folder is short enough for a socket.
    """

    def __init__(
        self, source: Path, folder: Path, seed: int, take: Callable[[CycleRecord], None]
    ) -> None:
        environ = {"XDG_RUNTIME_DIR": str(folder), "XDG_STATE_HOME": str(folder)}
        self.source, self.folder, self.take = source, folder, take
        self.paths: StagePaths = stage_paths(source, environ)
        self.config: DaemonConfig = load(source)
        self.clock, self.rig = VirtualClock(), CheckedRig(self.config, seed)
        self.steps = LockStep(self.clock)
        """The thread of the play."""
        self.rig.pause = self.steps.sleep
        self.loop: VirtualRun | None = None
        """The loop of the running daemon; None without one."""
        self.stall_ns = 0
        """For how long the whole machine stops before the next cycle, in ns."""

    @contextmanager
    def installed(self, log: TextIO) -> Iterator[None]:
        """Let the daemon's code in this process use this machine while the block runs."""
        now_s = partial(self._now_s)
        supervisor, run = "piezod.daemon.supervisor.supervisor", "piezod.daemon.supervisor.run"

        class VirtualRateLimit(EventRateLimit):  # a class, because the daemon looks for its kind
            def __init__(self) -> None:
                super().__init__(now_s)

        replaced: dict[str, object] = {
            f"{supervisor}.Heartbeat": _VirtualHeartbeat,
            f"{supervisor}.create_app": partial(create_app, now_s=now_s),
            f"{run}.LoopRun": partial(VirtualRun, self),
            "piezod.daemon.loop.play_thread._PlayThread": partial(SteppedPlay, self.steps),
            "piezod.daemon.loop.device_play.time": SimpleNamespace(sleep=self.steps.sleep),
            "piezod.daemon.logging.EventRateLimit": VirtualRateLimit,
            "piezod.daemon.service.access.ThreadPoolExecutor": AtOnce,
            "piezod.daemon.safe.ramp_down.construct": lambda *_: {"rig": self.rig},
        }
        requests_codec.warm_up()
        warm_up(self.config)
        with ExitStack() as stack:
            stack.enter_context(self.clock.installed())
            stack.enter_context(redirect_stderr(log))
            for name, by in replaced.items():
                stack.enter_context(patch(name, by))
            yield

    def _now_s(self) -> float:
        return self.clock.t_ns / NS_PER_S

    def run_daemon(self, beside: Callable[[], Coroutine[Any, Any, None]]) -> bool:
        """Run the daemon to its end; return whether that was in order.

        `beside` runs in the event loop of the daemon, until this ends.
        """

        async def both(main: Coroutine[Any, Any, T]) -> T:
            daemon, clients = asyncio.ensure_future(main), asyncio.ensure_future(beside())
            await asyncio.wait({daemon, clients}, return_when=asyncio.FIRST_COMPLETED)
            if not daemon.done():  # the clients failed
                daemon.cancel()
            elif not clients.done():
                clients.cancel()
            await asyncio.wait({daemon, clients})
            if not clients.cancelled():
                clients.result()
            return daemon.result()

        def run(main: Coroutine[Any, Any, T]) -> T:
            return run_virtually(both(main), self.pass_ns)

        gc.collect()  # the daemon before may still hold mapped files, which a process would not
        self.paths.make_folders()
        with Lock(self.paths.lock), patch("asyncio.run", run), suppress(StillDrivenError):
            return run_stage(self.source, RunOptions(), self.paths, Signals())
        return False

    def pass_ns(self, most_ns: int | None) -> None:
        """Let at most this time pass, until the next cycle of the loop or step of a play."""
        clock, loop, steps = self.clock, self.loop, self.steps
        end_ns = None if most_ns is None else clock.t_ns + most_ns
        if loop is not None and steps.due_ns <= min(loop.due_ns, end_ns or inf):
            clock.t_ns = max(clock.t_ns, int(steps.due_ns))
            steps.run()
            return
        if loop is not None and (end_ns is None or loop.due_ns <= end_ns):
            clock.t_ns += self.stall_ns
            self.stall_ns = 0
            loop.cycle()
        elif end_ns is not None:
            clock.t_ns = end_ns
        else:
            raise RuntimeError("nothing will ever happen")


class VirtualRun(LoopRun):
    """A loop in this process, in virtual time."""

    def __init__(
        self,
        machine: Machine,
        paths: StagePaths,
        source: Path,
        slot: str,
        *,
        strict_rt: bool = False,
    ) -> None:
        assert not strict_rt
        self.config_file = paths.runtime / slot / f"{paths.name}.yaml"
        self.started = False
        self.due_ns = 0
        """Instant of the next cycle."""
        self.source_files = SourceFiles(source)
        self._machine, self._paths, self._source = machine, paths, source
        self._overdue_ns = 0
        self._lock: Lock | None = None
        self._code: int | None = None

    def accept(self, ended: Callable[[], bool] = bool) -> bool:
        """Read the configuration."""
        self.config = load(self._source)
        accepted_config.keep(self.config, self.config_file.parent, self.config_file.stem)
        self.rescuer: Any = _VirtualRescuer(self._machine, self.config)
        return not ended()

    def start(self, succession: object = None, *, last_end: int = 0) -> None:
        """Open the rig and begin, as `loop.process` does."""
        assert succession is None
        self.started = True
        machine, clock, paths = self._machine, self._machine.clock, self._paths
        self.loop.shared.words[Word.UNCLEAN] = last_end
        self._shared = shared = attach(paths.loop_map, writable=True)
        shared.words[Word.LOOP_PID] = getpid()
        shared.words[Word.LOOP_ASKABLE] = 1
        self._lock = device_lock(paths.loop_lock)
        known = noted_identities(paths.identities)
        self._channels = channels = Channels({"rig": machine.rig}, pairs_of(self.config.axes))
        channels.open()
        channels.activate(clock.t_ns)
        shared.words[Word.DEVICES_OPEN] = 1
        note_identities(paths.identities, channels.identities)
        self._output = output = LastOutputWriter(paths.output_map, len(self.config.axes))
        timed = TimedChannels(channels, clock, output)
        plays = play_threads(self.config, channels, (), clock, paths.runtime / PLAYED)
        machine.rig.stage = stage = make_stage(
            self.config, timed, channels.capabilities(), lambda: output.forget(clock.t_ns), plays
        )
        self._controller = StageController(stage, LoopWatch(stage.period_ns, strict=False))
        noted_v = output.kept_v
        take_over(self._controller, shared, self.config, channels, known, noted_v)
        self._watch()
        self._period_ns, self._began_ns = shared.layout.period_ns, clock.t_ns
        self._loop = Loop(self._controller, timed, shared, clock, Pacer(clock, self._period_ns, 0))
        self.due_ns = clock.t_ns + self._period_ns
        machine.loop = self

    def _watch(self) -> None:
        """Hand the record of each cycle to the observer, too."""
        cycle, take = self._controller.cycle, self._machine.take

        def watched(t_ns: int, timing: Any) -> CycleRecord:
            record = cycle(t_ns, timing)
            take(record)
            return record

        self._controller.cycle = watched

    def cycle(self) -> None:
        """Run the next cycle; end after the last."""
        self._loop.cycle()
        passed = (self._machine.clock.t_ns - self._began_ns) // self._period_ns
        self.due_ns = self._began_ns + (passed + 1) * self._period_ns
        if self._controller.finished:
            self._loop.run()  # the last answers
            self._channels.close()
            self._end(0)

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while it runs."""
        return self._code

    def kill(self) -> None:
        """End at once, and leave everything as it is."""
        self._end(KILLED)

    def discard(self) -> None:
        """End before the start."""
        self._end(KILLED)

    def _end(self, code: int) -> None:
        if self._code is None:
            self._code = code
            self._machine.steps.kill()
            self._machine.loop = self._machine.rig.stage = None
            if self._lock is not None:
                self._lock.release()


class _VirtualHeartbeat(Heartbeat):
    """Beats by the event loop: a thread would beat in real time."""

    def start(self) -> None:
        """Start to beat."""
        self._beating = asyncio.ensure_future(self._beat())

    def stop(self) -> None:
        """End."""
        self._beating.cancel()

    async def _beat(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            now_ns = int(loop.time() * NS_PER_S)
            self.tick(now_ns)
            self.beat(now_ns)
            await asyncio.sleep(BEAT_S)


class _VirtualRescuer(FakeRescuer):
    """A rescuer in this process, in virtual time."""

    def __init__(self, machine: Machine, config: DaemonConfig) -> None:
        super().__init__()
        self._machine, self._config = machine, config

    def wait(self) -> list[str]:
        """Ramp down; return why an axis is not at its safe voltage."""
        paths, clock = self._machine.paths, self._machine.clock
        (last,) = LastOutputReader(paths.output_map).read()
        with device_lock(paths.loop_lock):
            noted = Noted({"x": last.drive_v}, noted_identities(paths.identities))
            outcomes = ramp_down(self._config, noted, WAIT_FOR_SAFE_S, clock)
            note_outcomes(paths.output_map, outcomes, clock.t_ns)
        return [outcomes["x"].why] if outcomes["x"].why else []
