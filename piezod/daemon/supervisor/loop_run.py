"""The loop process as its supervisor sees it: started, asked to end, replaced when it is gone."""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from piezod.config.daemon import DaemonConfig
from piezod.config.requests import Shutdown
from piezod.daemon.durations import ramp_s, ramped_down_within_s
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.service.stage_service import UnavailableError
from piezod.daemon.supervisor import accepted_config
from piezod.daemon.supervisor.connection import LoopConnection
from piezod.daemon.supervisor.notify import without_manager
from piezod.telemetry.layout import Layout
from piezod.telemetry.shared_map import create
from piezod.telemetry.words import Word
from piezod.units import NS_PER_S

END_GRACE_S: Final = 10.0
"""So much longer than its ramp the loop may take to end."""

_log = logger("supervisor")


class LoopRun:
    """One run of the loop process, with one configuration.

    Args:
        paths: The files of the stage.
        config: The configuration; a copy is kept for the loop to read.
        slot: Name of the folder for the copy; another than that of a configuration to go back to.

    Raises:
        OSError: If the copy or the memory shared with the loop cannot be made.
    """

    def __init__(self, paths: StagePaths, config: DaemonConfig, slot: str) -> None:
        self.config_file = accepted_config.keep(config, paths.runtime / slot, paths.name)
        shared = create(paths.loop_map, Layout.of(config))
        shared.words[Word.SUPERVISOR_PID] = os.getpid()
        self.loop = LoopConnection(config, shared)
        self.loop.beat(time.monotonic_ns())
        self._paths = paths
        self._process: subprocess.Popen[bytes] | None = None
        self._not_started = False
        self._overdue_ns = 0

    def start(self, *, unclean: bool = False) -> None:
        """Start the process; one that cannot be started has ended with code 1.

        Args:
            unclean: Whether the daemon did not end in order last time.
        """
        self.loop.shared.words[Word.UNCLEAN] = unclean
        runtime, config_file = str(self._paths.runtime), str(self.config_file)
        try:
            self._process = _start("piezod.daemon.loop.process", runtime, config_file)
        except OSError as error:
            _log.error("loop not started", why=str(error))
            self._not_started = True

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""
        if self._process is None:
            return 1 if self._not_started else None
        return self._process.poll()

    @property
    def begun(self) -> bool:
        """Whether the loop has come so far that it is to be asked; before that it has nothing."""
        return bool(self.loop.shared.words[Word.LOOP_ASKABLE])

    def ask_to_end(self) -> bool:
        """Ask the loop to ramp down and end; tell whether it was asked in time until now."""
        now_ns = time.monotonic_ns()
        if not self._overdue_ns:
            within_s = ramp_s(self.loop.config) + END_GRACE_S
            expires_ns = now_ns + int(within_s * NS_PER_S)
            try:
                self.loop.requests.post(Shutdown(), expires_ns)
            except UnavailableError:
                return True  # its mailbox is full: next time
            self._overdue_ns = expires_ns
        return now_ns < self._overdue_ns

    def kill(self) -> None:
        """End the process at once."""
        if self._process is not None:
            self._process.kill()


class RampDown:
    """`piezod safe` at work: brings a stage without a loop to its safe voltage.

    It takes the lock of the stage, so whoever starts this lets go of that first.

    Args:
        config_file: The configuration that was in force.
        config: What is in it.
    """

    def __init__(self, config_file: Path, config: DaemonConfig) -> None:
        self._within_s = ramped_down_within_s(config)
        self._process = _start("piezod.cli.main", "safe", str(config_file))

    def wait(self) -> bool:
        """Wait for its end; tell whether the safe voltage was reached and verified."""
        try:
            code = self._process.wait(self._within_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        if code:
            _log.error("ramp-down failed", code=code, what="the voltage in force is UNKNOWN")
        else:
            _log.warning("ramped down", what="the safe voltage was reached without the loop")
        return code == 0


def _start(module: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """Start a module of ours as a process that signals of our terminal do not reach.

    What it prints goes to our stderr. Not asyncio's processes: those kill the child when the parent
    ends by an error, and a loop without its supervisor has to ramp down.
    """
    return subprocess.Popen(  # noqa: S603 - our own interpreter and module
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=sys.stderr,
        # Linear algebra of this size needs no threads, and a real-time process wants none.
        env={**without_manager(os.environ), "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
    )
