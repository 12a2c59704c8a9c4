"""The guardian of a command that drives an axis, as the command sees it.

A killed process cannot undo anything itself. The guardian is another process, which then ramps the
axis back; it waits at the end of a pipe, which the kernel closes with the command.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from piezod.commission.bench import OneAxis
from piezod.errors import PiezodError

DONE: Final = "done\n"
READY: Final = "ready\n"


class Guardian:
    """The side of the command."""

    def __init__(self, config: Path) -> None:
        self._config = config
        command = [sys.executable, "-m", "piezod.cli.devices.guardian_process"]
        # A new session: Ctrl-C in a terminal reaches only the command, which ramps back by itself.
        self._process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def watch(self, axis: str, opened: OneAxis) -> None:
        """From now on bring this axis back to its initial voltage if this process is killed.

        Returns when the guardian has loaded all that it needs.

        Raises:
            PiezodError: If it cannot: then nothing may be driven.
        """
        job = {
            "config": str(self._config.absolute()),
            "axis": axis,
            "found_v": opened.session.found_v,
            "identities": opened.identities,
        }
        self._tell(json.dumps(job) + "\n")
        answer = self._process.stdout.readline() if self._process.stdout is not None else ""
        if answer != READY:
            raise PiezodError(
                f"nothing is driven, because the process that would bring axis {axis} back if this "
                f"command were killed is not ready: {answer.strip() or 'it has ended'}; repeat the "
                "command"
            )

    def end(self) -> None:
        """End the process: the axis was brought back, or nothing was driven."""
        self._tell(DONE)
        with suppress(BrokenPipeError):
            self._process.communicate()

    def _tell(self, line: str) -> None:
        if self._process.stdin is not None:
            # If somebody kills the guardian after it was ready, the command goes on without it.
            with suppress(BrokenPipeError):
                self._process.stdin.write(line)
                self._process.stdin.flush()


@contextmanager
def guardian(config: Path) -> Iterator[Guardian]:
    """Start a guardian for the time of the block; the caller owns the devices of the stage."""
    guard = Guardian(config)
    try:
        yield guard
    finally:
        guard.end()
