"""Watches what is learned on one axis, and the loop that is closed over it.

Detects D1, D2, D5 and D6.
"""

from collections.abc import Sequence
from typing import Final

from piezod.control.fault_register import Detection
from piezod.control.stage_model import StageModel
from piezod.hysteresis.adaptation import AdaptiveIdentifier
from piezod.hysteresis.normalisation import AffineRange

_NOTHING: Final[Sequence[Detection]] = ()


class AdaptationWatch:
    """Watches one axis; fixed memory.

    Args:
        axis: Index of the axis, for the detections.
        adaptation: What learns, `identifier.adaptation`.
        identified: The model that it started from; None for a stage not yet identified.
        position_um: Range of the displacement.
        period_ns: Period of the loop.
    """

    def __init__(
        self,
        axis: int,
        adaptation: AdaptiveIdentifier,
        identified: StageModel | None,
        position_um: AffineRange,
        period_ns: int,
    ) -> None:
        self._axis = axis

    def check(self, command_um: float, position_um: float, *, closed: bool) -> Sequence[Detection]:
        """Return what is wrong with the adaptation; call it once in each cycle, after the axes.

        May be called in the loop.

        Args:
            command_um: Displacement asked for, NaN where there is none.
            position_um: Measured displacement, NaN where the sample may not be used.
            closed: Whether the sample acts on the drive: mode `adaptive` or `trimmed`, in RUN.
        """
        return _NOTHING
