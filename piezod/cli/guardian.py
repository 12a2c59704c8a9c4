"""A process that ramps an axis back if the command that drives it is killed.

A killed process cannot undo anything itself. The guardian waits at the end of a pipe, which the
kernel closes with the process; it opens nothing before that.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from piezod.commission.bench import OneAxis
    from piezod.config.daemon import DaemonConfig

DONE: Final = "done\n"
WAIT_S: Final = 10.0
"""How long the amplifier may be unavailable after the end of the command, in s."""


class Guardian:
    """The side of the command.

    Args:
        config: Configuration of the stage.
    """

    def __init__(self, config: Path) -> None:
        self._config = config
        command = [sys.executable, "-m", "piezod.cli.guardian"]
        # A new session: Ctrl-C in a terminal reaches only the command, which ramps back by itself.
        self._process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            command, stdin=subprocess.PIPE, text=True, start_new_session=True
        )

    def watch(self, axis: str, opened: "OneAxis") -> None:
        """From now on bring this axis back to its initial voltage if this process is killed."""
        job = {
            "config": str(self._config.absolute()),
            "axis": axis,
            "found_v": opened.session.found_v,
            "identities": opened.identities,
        }
        self._tell(json.dumps(job) + "\n")

    def end(self) -> None:
        """End the process: the axis was brought back, or nothing was driven."""
        self._tell(DONE)
        with suppress(BrokenPipeError):
            self._process.communicate()

    def _tell(self, line: str) -> None:
        if self._process.stdin is not None:
            # If somebody has killed the guardian, the command is without it, as it used to be.
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


def main() -> None:
    """Wait for the end of the command, and ramp the axis back that it has not brought back."""
    job, line = "", sys.stdin.readline()
    while line not in {"", DONE}:
        job, line = line, sys.stdin.readline()
    if line != DONE and job:
        _ramp_back(**json.loads(job))


def _ramp_back(config: str, axis: str, found_v: float, identities: dict[str, list[str]]) -> None:
    from piezod.cli.owned_stage import owning
    from piezod.config.daemon import load_daemon
    from piezod.daemon.clock import MonotonicClock
    from piezod.daemon.output_notes import OutputNotes
    from piezod.daemon.paths import stage_paths
    from piezod.daemon.safe.ramp_down import Noted, ramp_down
    from piezod.devices import registry
    from piezod.devices.interface import Identity

    with owning(Path(config)):
        stage = load_daemon(Path(config), registry)
        notes = OutputNotes(stage, stage_paths(Path(config)))
        known = {name: Identity(*who) for name, who in identities.items()}
        one, noted = _with_target(stage, axis, found_v), Noted({axis: notes.last_v(axis)}, known)
        outcome = ramp_down(one, noted, WAIT_S, MonotonicClock())[axis]
        notes.note(axis, outcome.written_v)
    text = outcome.why or f"ramped from {outcome.from_v:.2f} V to {outcome.safe_v:.2f} V"
    unknown = "the voltage is UNKNOWN: " if outcome.why else ""
    print(f"piezod: the command was killed; axis {axis}: {unknown}{text}", file=sys.stderr)


def _with_target(stage: "DaemonConfig", axis: str, found_v: float) -> "DaemonConfig":
    """Return the stage with one axis only, whose safe voltage is the initial voltage."""
    one = stage.axes[axis]
    target_v = min(max(found_v, one.limits.drive_min_v), one.limits.drive_max_v)
    safety = one.safety.model_copy(update={"safe_v": target_v})
    return stage.model_copy(update={"axes": {axis: one.model_copy(update={"safety": safety})}})


if __name__ == "__main__":
    main()
