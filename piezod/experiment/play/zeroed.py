"""An axis whose zero is the mean of a play at rest.

A zero of the loop is the mean of some hundred samples. Its noise would be an error of the mean of
every waveform.
"""

import numpy as np

from piezod.devices.played_axis import AxisPlayRecord, AxisTable
from piezod.experiment.play.stage import AtRest, PlayedStage
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

ZERO_S = 1.0
"""Duration of the play at rest, in s."""
_LONGEST_PERIOD = 100
"""Points of its table, which repeats: the memory of a device may be small."""


class ZeroedAxis:
    """Implements `PlayedStage` by another one, relative to its zero.

    Args:
        axis: The axis, at rest; it plays its rest voltage now.
        interval_ns: Time between two points, in ns.
        conditioning: Table that brings the axis to the rest of its model first; None for none.

    Raises:
        PiezodError: If the play failed.
    """

    def __init__(
        self, axis: PlayedStage, interval_ns: int, conditioning: AxisTable | None = None
    ) -> None:
        self._axis = axis
        if conditioning is not None:
            axis.play(conditioning)
        points = max(1, round(ZERO_S * NS_PER_S / interval_ns))
        period = min(points, _LONGEST_PERIOD)
        period_v = np.full(period, axis.rest().drive_v)
        record = axis.play(AxisTable(interval_ns, np.empty(0), period_v, points // period))
        self.zero_um = _mean(record.position_um)
        self.true_zero_um = _mean(record.true_um)

    def rest(self) -> AtRest:
        """Bring the axis to rest."""
        return self._axis.rest()

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table and return its record, relative to the zero."""
        record = self._axis.play(table)
        return record._replace(
            position_um=record.position_um - self.zero_um,
            true_um=record.true_um - self.true_zero_um,
        )


def _mean(values: FloatArray) -> float:
    """Return the mean of the valid samples; 0 if there is none."""
    valid = values[np.isfinite(values)]
    return float(np.mean(valid)) if valid.size else 0.0
