"""The voltages that are driven in IDENT, step by step."""

from collections.abc import Mapping, Sequence

from piezod.control.reference.programs import VoltageProgram
from piezod.control.stage.axis import StageAxis

DriveStep = Mapping[int, VoltageProgram | float]
"""What some axes do at the same time, by index: a voltage over time, or a ramp to a voltage."""


class DriveSequence:
    """Drives the steps one after the other; axes that a step does not name hold."""

    def __init__(self) -> None:
        self._steps: list[DriveStep] = []
        self.makes_memory_known = False
        """Whether the hysteresis memory is known at its end."""

    def start(
        self, axes: Sequence[StageAxis], steps: Sequence[DriveStep], t_ns: int, *, conditions: bool
    ) -> None:
        """Begin with the first step. Real-time safe.

        Args:
            axes: All axes of the stage.
            steps: What to drive, in order.
            t_ns: Instant of the cycle.
            conditions: Whether the hysteresis memory is known at the end.
        """
        self._steps, self.makes_memory_known = list(steps), conditions
        self._begin_next(axes, t_ns)

    def clear(self) -> None:
        """Drop the steps that are left. Real-time safe."""
        self._steps.clear()

    def ended(self, axes: Sequence[StageAxis], t_ns: int) -> bool:
        """Go on; return whether the last step has ended. Call once per cycle. Real-time safe."""
        if not all(axis.drive_ended(t_ns) for axis in axes):
            return False
        return not self._begin_next(axes, t_ns)

    def _begin_next(self, axes: Sequence[StageAxis], t_ns: int) -> bool:
        """Begin the next step; return whether there is one."""
        if not self._steps:
            return False
        step = self._steps.pop(0)
        for i, axis in enumerate(axes):
            match step.get(i):
                case None:
                    axis.hold()
                case VoltageProgram() as program:
                    axis.drive(program, t_ns)
                case voltage:
                    axis.ramp_to(voltage)
        return True
