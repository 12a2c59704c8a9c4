"""The supervisor's side of the rescuer, which ramps a stage down that has lost its loop.

The rescuer is a process that waits from the start on. What happens to the installation meanwhile
does not matter to it.
"""

import json
import os
import time
from contextlib import suppress
from pathlib import Path
from select import select
from typing import Final

from piezod.config.daemon import DaemonConfig
from piezod.daemon.durations import ramped_down_within_s
from piezod.daemon.last_output import LastOutputReader, LastOutputWriter, stays
from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor import processes

MODULE: Final = "piezod.daemon.safe.rescuer"
AGAIN_S: Final = 10.0
"""Time between two starts of a rescuer that ends by itself, in s."""
_READY: Final = b"ready\n"
_RAMP: Final = b"ramp\n"

_log = logger("supervisor")


class Rescuer:
    """The rescuer of one run of the loop; it opens no device before `begin`.

    Args:
        paths: The files of the stage.
        config_file: The accepted copy of the configuration.
        config: Its contents.

    Raises:
        OSError: If it cannot be started.
    """

    def __init__(self, paths: StagePaths, config_file: Path, config: DaemonConfig) -> None:
        # Made before the loop and the rescuer map it: both have the same file, whoever removes it.
        LastOutputWriter(paths.output_map, len(config.axes))
        self._output, self._config = LastOutputReader(paths.output_map), config
        self._arguments = (paths.name, str(paths.runtime), str(paths.state), str(config_file))
        self._start()

    def _start(self) -> None:
        self._started_s, self._ready, self._lines = time.monotonic(), False, b""
        self._process = processes.start(MODULE, *self._arguments)

    @property
    def ready(self) -> bool:
        """Whether it has loaded all that a ramp needs, and lives."""
        if not self._ready and not self._has_ended:
            self._ready = self._line(0.0) == _READY
        return self._ready and not self._has_ended

    @property
    def _has_ended(self) -> bool:
        return self._process.poll() is not None

    def keep(self) -> None:
        """Start it again if it has ended, as by the kernel without memory; call this often."""
        if not self._has_ended or time.monotonic() < self._started_s + AGAIN_S:
            return
        _log.error("rescuer gone", code=self._process.poll(), what="another one is started")
        self.end()
        try:
            self._start()
        except OSError as error:
            self._started_s = time.monotonic()
            _log.error("no rescuer", why=str(error), what="restart the daemon when at rest")

    def begin(self) -> None:
        """Let it ramp the stage down; the loop has ended, or ends by itself."""
        if self._has_ended:
            with suppress(OSError):  # then `wait` says which voltage stays
                self.end()
                self._start()
        self._say(_RAMP)

    def wait(self) -> list[str]:
        """Wait for the end of the ramp.

        Returns:
            For each axis that is not at its safe voltage a line that says why, and which voltage
            stays; nothing if the safe voltage was reached and verified.
        """
        end_s = time.monotonic() + ramped_down_within_s(self._config)
        line = self._line(end_s - time.monotonic())
        if line == _READY:
            self._ready = True
            line = self._line(end_s - time.monotonic())
        reached: list[str] = []
        if not line:
            self._process.kill()  # a driver hangs
            why = f"the rescuer has given no answer (exit code {self._process.wait()})"
            last_v = self._output.of(self._config.axes)
            left = [f"axis {each}: {why}; {stays(drive_v)}" for each, drive_v in last_v.items()]
        else:
            reached, left = (list(json.loads(line)[key]) for key in ("reached", "left"))
        for each in reached:
            _log.warning("ramped down", what=each)
        for each in left:
            _log.error("ramp-down failed", what=each)
        return left

    def end(self) -> None:
        """End it while it does not ramp: nothing is driven, or another rescuer is there."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what was said and not read
                    pipe.close()

    def _say(self, word: bytes) -> None:
        if self._process.stdin is not None:
            with suppress(OSError):  # it has ended
                self._process.stdin.write(word)
                self._process.stdin.flush()

    def _line(self, within_s: float) -> bytes:
        """Return its next line; empty if there is none in time, or it has ended."""
        output, end_s = self._process.stdout, time.monotonic() + within_s
        while output is not None and b"\n" not in self._lines:
            if not select([output], [], [], max(end_s - time.monotonic(), 0.0))[0]:
                return b""
            block = os.read(output.fileno(), 4096)
            if not block:
                return b""
            self._lines += block
        line, _, self._lines = self._lines.partition(b"\n")
        return line + b"\n"
