"""One run of the loop process: started, asked to end, killed; and `piezod safe` in its place."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from select import select
from typing import Any, Final

from piezod.config.daemon import DaemonConfig
from piezod.config.requests import Shutdown
from piezod.daemon import accepted_config
from piezod.daemon.durations import ramp_s, ramped_down_within_s
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.service.stage_service import UnavailableError
from piezod.daemon.supervisor.connection import LoopConnection
from piezod.daemon.supervisor.notify import without_manager
from piezod.daemon.supervisor.source_files import SourceFiles
from piezod.errors import ConfigError, PiezodError, Problem
from piezod.service_view import who_may_change
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from piezod.telemetry.succession import Succession, put_succession
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

END_GRACE_S: Final = 10.0
"""How much longer than its ramp the loop may take to end, in s."""
_POLL_S: Final = 0.1

_log = logger("supervisor")


class LoopRun:
    """One run of the loop process, with one configuration.

    The process accepts the configuration at once (`accept`), and drives nothing before `start`.

    Args:
        paths: The files of the stage.
        source: The configuration file.
        slot: Name of the folder for the accepted copy; `source` is in another one.
        strict_rt: Whether to set `loop.strict_rt`, whatever the file says.
        warm: Whether the process compiles before it accepts, so that it starts soon afterwards.

    Attributes:
        config_file: Path of the accepted copy.
        config: The accepted configuration, after `accept`.
        started: Whether the process may open the devices.
        source_files: The configuration file and, after `accept`, the files that it names; compared
            with their present contents.
    """

    def __init__(
        self,
        paths: StagePaths,
        source: Path,
        slot: str,
        *,
        strict_rt: bool = False,
        warm: bool = False,
    ) -> None:
        self.config_file = paths.runtime / slot / f"{paths.name}.yaml"
        self.started = False
        self._paths, self._source, self._overdue_ns = paths, source, 0
        self.source_files = SourceFiles(source)  # before the process reads it
        places = (paths.runtime, source, self.config_file, paths.loop_lock)
        options = {"--strict-rt": strict_rt, "--warm": warm}
        chosen = [option for option, is_set in options.items() if is_set]
        self._process = _start("piezod.daemon.loop.process", *map(str, places), *chosen, piped=True)

    def accept(self, ended: Callable[[], bool] = bool) -> bool:
        """Wait until the process has accepted the configuration.

        Args:
            ended: Returns whether to stop waiting; called several times a second.

        Returns:
            Whether it has accepted; False if `ended` stopped the wait.

        Raises:
            ConfigError: If the configuration is not valid; the text has every problem.
            PiezodError: If the process ended without an answer.
            OSError: If the accepted copy cannot be made.
        """
        answer = self._read_line(ended)
        if answer is None:
            self.discard()
            return False
        if "problems" in answer:
            self.discard()
            raise ConfigError(*(Problem(*problem) for problem in answer["problems"]))
        if "failed" in answer:
            self.discard()
            raise OSError(*answer["failed"])
        self.source_files.add(answer["named_files"])
        for file in (self._source, *map(Path, answer["named_files"])):
            for sentence in who_may_change(file):
                _log.warning("others may change a file", text=sentence)
        self.config = accepted_config.parsed(json.dumps(answer["accepted"]), self._source)
        return True

    @cached_property
    def loop(self) -> LoopConnection:
        """Connection to the loop, by a shared memory that is made at the first use.

        Raises:
            OSError: If the shared memory cannot be made.
        """
        # Not in `accept`: it takes the place of the memory of the running loop.
        shared = create(self._paths.loop_map, Layout.of(self.config))
        shared.words[Word.SUPERVISOR_PID] = os.getpid()
        loop = LoopConnection(self.config, shared)
        loop.beat(time.monotonic_ns())
        return loop

    def _read_line(self, ended: Callable[[], bool]) -> dict[str, Any] | None:
        output = self._process.stdout
        if output is None:
            raise PiezodError("the loop process has no output")
        # The process writes one line here, then redirects its output to stderr: the pipe may close.
        with output:
            while not select([output], [], [], _POLL_S)[0]:
                if ended():
                    return None
            line = output.readline()
        if not line:
            code = self._process.wait()
            what = f"the loop process ended with code {code} before it had read the configuration"
            raise PiezodError(f"{what}; the log says why")
        answer: dict[str, Any] = json.loads(line)
        return answer

    @property
    def idle(self) -> bool:
        """Whether the loop has not run a cycle, and so has driven nothing."""
        words = self.loop.shared.words
        return not words[Word.HEALTHY_CYCLES] and self.loop.latest() is None

    def start(self, succession: Succession | None = None, *, last_end: int = 0) -> None:
        """Let the process open the devices and run.

        Args:
            succession: What it takes over from the loop that it replaces.
            last_end: How the daemon ended last time: a value of `Word.UNCLEAN`.
        """
        self.started = True
        if succession is not None:
            put_succession(self.loop.shared, succession)
        self.loop.shared.words[Word.UNCLEAN] = last_end
        if self._process.stdin is not None:
            # If it has ended already, its exit code is the report.
            with suppress(BrokenPipeError), self._process.stdin as pipe:
                pipe.write(b"start\n")

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def takes_requests(self) -> bool:
        """Whether the loop answers requests; before that it has touched no device."""
        return bool(self.loop.shared.words[Word.LOOP_ASKABLE])

    def request_end(self) -> bool:
        """Ask the loop to ramp down and end; return False when it has not done so in time."""
        now_ns = time.monotonic_ns()
        if not self._overdue_ns:  # the request is posted once
            within_s = ramp_s(self.loop.config) + END_GRACE_S
            expires_ns = now_ns + int(within_s * NS_PER_S)
            try:
                self.loop.requests.post(Shutdown(), expires_ns)
            except UnavailableError:
                return True  # its mailbox is full: try again at the next call
            self._overdue_ns = expires_ns
        return now_ns < self._overdue_ns

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()

    def discard(self) -> None:
        """Kill a process that was not started: it has touched no device."""
        self._process.kill()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


class RampDown:
    """A process of `piezod safe`: brings a stage without a loop to its safe voltage.

    It takes the lock of the stage: release that before.

    Args:
        config_file: The configuration that was in force.
        config: Its contents.
    """

    def __init__(self, config_file: Path, config: DaemonConfig) -> None:
        self._within_s = ramped_down_within_s(config)
        self._process = _start("piezod.cli.main", "safe", str(config_file))

    def wait(self) -> bool:
        """Wait for its end; return whether the safe voltage was reached and verified."""
        try:
            code = self._process.wait(self._within_s)
        except subprocess.TimeoutExpired:  # a driver hangs
            self._process.kill()
            code = self._process.wait()
        if code:
            _log.error("ramp-down failed", code=code, what="the voltage in force is UNKNOWN")
        else:
            _log.warning("ramped down", what="the safe voltage was reached without the loop")
        return code == 0


def _start(module: str, *arguments: str, piped: bool = False) -> "subprocess.Popen[bytes]":
    """Start a module of piezod as a process that the signals of this terminal do not reach.

    It is no process of asyncio, which would kill it when this process ends with an error: a loop
    without its supervisor has to ramp down.

    Args:
        module: The module.
        arguments: Its arguments.
        piped: Whether this process reads its standard output and writes to its standard input;
            otherwise its output goes to stderr.
    """
    # A new session: Ctrl-C in a terminal reaches only the supervisor.
    return subprocess.Popen(  # noqa: S603 - our own interpreter and module
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE if piped else subprocess.DEVNULL,
        stdout=subprocess.PIPE if piped else sys.stderr,
        # Linear algebra of this size needs no threads, and they would disturb a real-time process.
        env={**without_manager(os.environ), "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
    )
