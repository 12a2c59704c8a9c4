"""Serves an emulated device, as `piezod emulate`, and stores the true displacement of each play.

Arguments: profile, configuration with the rig, file for the displacements. The file has one for
each sample of the play; it is written when the play has ended. A line of standard output has the
place of the device.
"""

import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from piezod.cli.devices.emulate_parts import posts_of, rig_of
from piezod.devices.emulation.bench import SharedRig, step_ns_of
from piezod.devices.emulation.rig_clock import RigClock
from piezod.devices.emulators import Emulation
from piezod.devices.interface import Wiring
from piezod.records.atomic import replacing
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions


class TrueBench(SharedRig):
    """A shared rig that stores the true displacement at each sample of a play.

    Args:
        rig: The rig, open and active.
        file: The file.
    """

    def __init__(self, rig: SimulatedRig, file: Path) -> None:
        self._true_rig, self._file = rig, file
        self._true_um: list[float] = []
        super().__init__(rig, RigClock(time.monotonic_ns))

    def positions_um(self, at_ns: int | None = None) -> list[float]:
        """Only a play names the instants of its samples."""
        positions_um = super().positions_um(at_ns)
        if at_ns is not None:
            self._true_um.append(self._true_rig.true_position_um(self._latest_ns)[0])
        return positions_um

    def plays_from(self, next_ns: int | None) -> None:
        super().plays_from(next_ns)
        if next_ns is None and self._true_um:
            with replacing(self._file) as temporary:
                np.array(self._true_um).tofile(temporary)
            self._true_um.clear()


def main() -> None:
    """Serve the device until standard input ends."""
    profile, config, file = sys.argv[1:]
    plan = rig_of(Path(config), None, None)
    assert isinstance(plan.options, SimulatedOptions)
    rig = SimulatedRig(plan.options, Wiring(("x", "x_v"), ("x",)), plan.seed)
    with closing(rig):
        rig.open()
        now_ns = time.monotonic_ns()
        rig.activate(now_ns - now_ns % step_ns_of(rig))
        emulation = Emulation(posts_of([profile], None, ()), TrueBench(rig, Path(file)))
        try:
            print(*emulation.start(), flush=True)
            sys.stdin.read()
        finally:
            emulation.stop()


if __name__ == "__main__":
    main()
