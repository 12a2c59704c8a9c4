"""A simulated rig that writes down where it truly is: `python -m tests.bluesky.truth_rig`.

Arguments are its socket and a file. Each sample that the daemon takes adds a row to the file: the
instant in ns on the monotonic clock, and the true displacement in µm.
"""

import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TextIO, cast

from piezod.cli.devices.emulate_parts import rig_of, stop_requested
from piezod.devices import registry
from piezod.devices.emulation.bench import Rig, SharedRig, step_ns_of
from piezod.devices.emulation.faults import WireFaults
from piezod.devices.emulation.rig_clock import RigClock
from piezod.devices.interface import Sample, Wiring
from piezod_drivers.emulated.emulator import serve
from tests.daemon.daemons import SHIPPED

PRIORITY: Final = 50


class TruthfulRig:
    """A simulated rig whose samples leave the truth in a file."""

    def __init__(self, rig: Any, file: TextIO) -> None:
        self._rig, self._file = rig, file

    def __getattr__(self, name: str) -> Any:
        """Return whatever else the rig has."""
        return getattr(self._rig, name)

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return the samples."""
        samples: Sequence[Sample] = self._rig.read(now_ns)
        self._file.write(f"{now_ns},{self._rig.true_position_um(now_ns)[0]}\n")
        return samples


def main(socket: str, file: Path) -> None:
    """Serve the rig of the shipped configuration until SIGTERM."""
    with suppress(PermissionError):  # a real rig does not wait for a busy processor
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    plan = rig_of(SHIPPED, None, None)
    made = registry.load("simulated").create(plan.options, Wiring(("x", "x_v"), ("x",)), plan.seed)
    with stop_requested() as stopping, file.open("w", buffering=1) as opened:
        rig = TruthfulRig(made, opened)
        identity = rig.open()
        now_ns = time.monotonic_ns()
        rig.activate(now_ns - now_ns % step_ns_of(cast("Rig", rig)))
        bench = SharedRig(cast("Rig", rig), RigClock(time.monotonic_ns), None, identity)
        serve(
            bench, socket, WireFaults([]), "", lambda _place: print("serving", flush=True), stopping
        )


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
