"""The voltages that are driven in IDENT, step by step."""

from collections.abc import Mapping, Sequence

from piezod.control.reference.programs import VoltageProgram
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.playing import StagePlay
from piezod.devices.played_axis import AxisTable
from piezod.devices.scan_table import ScanTable

DriveStep = Mapping[int, VoltageProgram | AxisTable | ScanTable | float]
"""One step: for each axis, by index, a voltage over time, a table in V that the device plays, or a
voltage to ramp to. A step with a table has no other entry, one of a scan the same for all axes."""


class DriveSequence:
    """Drives steps one after the other; axes without an entry in a step hold. Real-time safe."""

    def __init__(self, play: StagePlay) -> None:
        self._play = play
        self._steps: list[DriveStep] = []
        self.makes_memory_known = False
        """Whether the hysteresis memory is known at the end."""

    def start(
        self, axes: Sequence[StageAxis], steps: Sequence[DriveStep], t_ns: int, *, conditions: bool
    ) -> None:
        """Start the first step.

        Args:
            axes: All axes of the stage.
            steps: Steps, in order.
            t_ns: Instant of the cycle, in ns.
            conditions: Whether the hysteresis memory is known at the end.
        """
        self._steps, self.makes_memory_known = list(steps), conditions
        self._start_next(axes, t_ns)

    def clear(self) -> None:
        """Drop the remaining steps, and abort a play."""
        self._steps.clear()
        self._play.abort()

    def ended(self, axes: Sequence[StageAxis], t_ns: int) -> bool:
        """Start the next step when one has ended; return whether all have ended.

        Call once per cycle.
        """
        if not all(axis.drive_ended(t_ns) for axis in axes):
            return False
        return not self._start_next(axes, t_ns)

    def _start_next(self, axes: Sequence[StageAxis], t_ns: int) -> bool:
        """Start the next step; return whether there is one."""
        if not self._steps:
            return False
        step = self._steps.pop(0)
        for i, axis in enumerate(axes):
            match step.get(i):
                case None:
                    axis.hold()
                case VoltageProgram() as program:
                    axis.drive(program, t_ns)
                case AxisTable() as table:
                    axis.hold()
                    self._play.begin(i, table)
                case ScanTable():
                    axis.hold()
                case voltage:
                    axis.ramp_to(voltage)
        first = next(iter(step.values()), None)
        if isinstance(first, ScanTable):
            self._play.begin_scan(tuple(step), first)
        return True
