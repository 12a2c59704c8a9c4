"""One run of the loop process, with its rescuer: started, asked to end, killed."""

import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from select import select
from typing import Any, Final

from piezod import __version__
from piezod.daemon import accepted_config
from piezod.daemon.durations import loop_gone_within_s
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.stage.connection import LoopConnection
from piezod.daemon.stage.errors import UnavailableError
from piezod.daemon.supervisor import processes
from piezod.daemon.supervisor.rescuer import Rescuer
from piezod.daemon.supervisor.source_files import SourceFiles
from piezod.errors import ConfigError, PiezodError, Problem
from piezod.messages.requests import Shutdown
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
        rescuer: Ramps the stage down if the loop is lost, after `accept`.
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
        self._process = processes.start("piezod.daemon.loop.process", *map(str, places), *chosen)

    def accept(self, ended: Callable[[], bool] = bool) -> bool:
        """Wait until the process has accepted the configuration.

        Args:
            ended: Returns whether to stop waiting; called several times a second.

        Returns:
            Whether it has accepted; False if `ended` stopped the wait.

        Raises:
            ConfigError: If the configuration is not valid; the text has every problem.
            PiezodError: If the process ended without an answer, or is of another version.
            OSError: If the accepted copy cannot be made, or the rescuer cannot be started.
        """
        answer = self._read_line(ended)
        if answer is None:
            self._kill()
            return False
        if "problems" in answer:
            self._kill()
            raise ConfigError(*(Problem(*problem) for problem in answer["problems"]))
        if "failed" in answer:
            self._kill()
            raise OSError(*answer["failed"])
        if answer["version"] != __version__:  # it would not understand this process
            self._kill()
            what = f"piezod {answer['version']} is installed now, and {__version__} runs"
            raise PiezodError(f"{what}: restart the daemon when the stage is at rest")
        self.source_files.add(answer["named_files"])
        for file in (self._source, *map(Path, answer["named_files"])):
            for sentence in who_may_change(file):
                _log.warning("others may change a file", text=sentence)
        self.config = accepted_config.parsed(json.dumps(answer["accepted"]), self._source)
        # It loads while the loop compiles; `arm` waits for it.
        try:
            self.rescuer = Rescuer(self._paths, self.config_file, self.config)
        except OSError:
            self._kill()
            raise
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
            within_s = loop_gone_within_s(self.loop.config) + END_GRACE_S
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
        """Kill a process that was not started, and end its rescuer: no device was touched."""
        self._kill()
        self.rescuer.end()

    def _kill(self) -> None:
        self._process.kill()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()
