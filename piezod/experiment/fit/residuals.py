"""Residuals of a model: predicted minus recorded voltage, and predicted minus recorded position."""

from typing import NamedTuple

import numpy as np

from piezod.experiment.fit.record import Rows
from piezod.hysteresis.memory import FloatArray


class Residuals(NamedTuple):
    """Residuals of the samples that count, shape (k,) each."""

    #: Voltage predicted from the position, minus the recorded one, in % of its range.
    voltage_pct: FloatArray
    #: Position predicted from the voltage, minus the recorded one, in % of its range.
    position_pct: FloatArray

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms error of both, by name."""
        return {
            "voltage_error_max_pct": float(np.max(np.abs(self.voltage_pct))),
            "voltage_error_rms_pct": rms_of(self.voltage_pct),
            "position_error_max_pct": float(np.max(np.abs(self.position_pct))),
            "position_error_rms_pct": rms_of(self.position_pct),
        }

    @property
    def offsets_pct(self) -> tuple[float, float]:
        """Constant part of both, in %."""
        return float(np.mean(self.voltage_pct)), float(np.mean(self.position_pct))

    def without_offsets(self) -> "Residuals":
        """Return the residuals without their constant parts."""
        voltage_pct, position_pct = self.offsets_pct
        return Residuals(self.voltage_pct - voltage_pct, self.position_pct - position_pct)

    def at(self, places: Rows) -> "Residuals":
        """Return the residuals of some samples; mask of shape (k,)."""
        return Residuals(self.voltage_pct[places], self.position_pct[places])

    @classmethod
    def joined(cls, parts: "list[Residuals]") -> "Residuals":
        """Return the residuals of several parts, one after the other."""
        voltages_pct, positions_pct = zip(*parts, strict=True)
        return cls(np.concatenate(voltages_pct), np.concatenate(positions_pct))


def rms_of(values: FloatArray) -> float:
    """Return the rms of values."""
    return float(np.sqrt(np.mean(values**2)))
