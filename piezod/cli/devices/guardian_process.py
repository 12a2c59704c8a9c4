"""A process that ramps an axis back if the command that drives it is killed.

It loads whatever that needs before the command drives, and opens nothing before the command ends.
So it works when the installation has been moved or replaced meanwhile.
"""

import json
import sys
from pathlib import Path
from typing import Final

from piezod.cli.devices.guardian import DONE, READY
from piezod.cli.devices.owned_stage import owning
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import stage_paths
from piezod.daemon.safe.ramp_down import Noted, load_drivers, ramp_down
from piezod.devices import registry
from piezod.devices.interface import Identity
from piezod.errors import PiezodError

WAIT_S: Final = 10.0
"""How long the amplifier may be unavailable after the end of the command, in s."""


class _Axis:
    """An axis that is driven; arguments as `Guardian.watch` sends them."""

    def __init__(
        self, config: str, axis: str, found_v: float, identities: dict[str, list[str]]
    ) -> None:
        self._file, self._axis, self._found_v = Path(config), axis, found_v
        self._identities = {name: Identity(*who) for name, who in identities.items()}
        self._stage = load_daemon(self._file, registry)
        load_drivers(self._stage)

    def ramp_back(self) -> None:
        """Ramp to the initial voltage, and print how that ended."""
        axis = self._axis
        with owning(self._file):
            notes = OutputNotes(self._stage, stage_paths(self._file))
            noted = Noted({axis: notes.last_v(axis)}, self._identities)
            outcome = ramp_down(self._one(), noted, WAIT_S, MonotonicClock())[axis]
            notes.note(axis, outcome.written_v)
        text = outcome.why or f"ramped from {outcome.from_v:z.2f} V to {outcome.safe_v:z.2f} V"
        unknown = "the voltage is UNKNOWN: " if outcome.why else ""
        print(f"piezod: the command was killed; axis {axis}: {unknown}{text}", file=sys.stderr)

    def _one(self) -> DaemonConfig:
        """Return the stage with this axis only, whose safe voltage is the initial voltage."""
        one = self._stage.axes[self._axis]
        target_v = min(max(self._found_v, one.limits.drive_min_v), one.limits.drive_max_v)
        safety = one.safety.model_copy(update={"safe_v": target_v})
        axes = {self._axis: one.model_copy(update={"safety": safety})}
        return self._stage.model_copy(update={"axes": axes})


def main() -> None:
    """Wait for the end of the command, and ramp the axis back that it has not brought back."""
    axis: _Axis | None = None
    while (line := sys.stdin.readline()) not in {"", DONE}:
        try:
            axis = _Axis(**json.loads(line))
        except (PiezodError, OSError) as error:
            print(" ".join(str(error).split()), flush=True)
            return
        print(READY, end="", flush=True)
    if line != DONE and axis is not None:
        axis.ramp_back()


if __name__ == "__main__":
    main()
