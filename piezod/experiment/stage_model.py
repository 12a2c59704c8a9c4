"""What is known of a stage: its inverse model, with the ranges, the creep and the delay."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.errors import DataError
from piezod.experiment.creep_law import NO_CREEP, CreepLaw
from piezod.experiment.record import Record
from piezod.hysteresis import AffineRange, InverseMPI, stop_regressors
from piezod.hysteresis.creep import remove_creep
from piezod.hysteresis.memory import FloatArray

REST_BEYOND = 0.01
"""The rest voltage may leave a model's voltages by this part of them."""


@dataclass(frozen=True)
class StageModel:
    """An identified inverse model with the ranges, the creep and the delay that it holds for.

    Attributes:
        bank: (2, 2 M) thresholds and gains of the stops.
        weights: (2 M,) weights [a^l, a^r].
        drive_v: Range of the drive that is [0, 1], in V.
        position_um: Range of the displacement without creep that is [0, 1], in µm.
        delay_s: How long the displacement lags behind the voltage, in s.
        creep: What the displacement adds to its quick part in time.
    """

    bank: FloatArray
    weights: FloatArray
    drive_v: AffineRange
    position_um: AffineRange
    delay_s: float
    creep: CreepLaw = NO_CREEP

    def inverse(self) -> InverseMPI:
        """Return the inverse model itself, relaxed."""
        left, right = np.split(self.bank[0], 2)
        left_weights, right_weights = np.split(self.weights, 2)
        return InverseMPI(right, left, right_weights, left_weights)

    def zeroed_at(self, rest_v: float) -> "StageModel":
        """Return the model with its displacement counted from that at rest.

        A stage is zeroed at rest before it is driven; recorded data may count from elsewhere.

        Args:
            rest_v: Voltage at rest, in V.

        Raises:
            DataError: If that is outside the voltages that the model holds for.
        """
        rest = self.drive_v.to_unit(rest_v)
        if not -REST_BEYOND <= rest <= 1.0 + REST_BEYOND:
            raise DataError(
                f"the model holds from {self.drive_v.low:g} to {self.drive_v.high:g} V, which "
                f"leaves out the rest voltage, {rest_v:g} V; identify from rest on"
            )
        x = np.linspace(0.0, 1.0, 2001)
        z = np.maximum.accumulate(self.inverse().run(x))
        rest_um = self.position_um.from_unit(float(np.interp(rest, z, x)))
        low, high = self.position_um
        return replace(self, position_um=AffineRange(low - rest_um, high - rest_um))

    def quick_positions(self, record: Record) -> FloatArray:
        """Return recorded displacements without creep, normalised to [0, 1], shape (n,).

        What a stage did that does not start from rest is taken to have been like the record on
        average.
        """
        x = self.position_um.to_unit(record.position_um)
        return without_creep(x, self.creep, record.period_s, from_rest=record.from_rest)

    def predicted_v(self, record: Record, deadband: float = 0.0) -> FloatArray:
        """Return the voltage that the model needs for a recorded displacement, in V, shape (n,).

        Args:
            record: What was measured; the memory starts relaxed at its first sample.
            deadband: Width of the backlash before the memory, in units of the range.
        """
        y = np.clip(self.quick_positions(record), 0.0, 1.0)
        return self.drive_v.from_unit(y + stop_regressors(self.bank, y, deadband) @ self.weights)


def without_creep(
    positions: FloatArray, creep: CreepLaw, period_s: float, *, from_rest: bool
) -> FloatArray:
    """Return displacements over time without creep, in the same unit, shape (n,).

    Args:
        positions: (n,) displacement, evenly in time.
        creep: The creep.
        period_s: Time from sample to sample, in s.
        from_rest: Whether the lags begin at the first displacement; at the mean if not.
    """
    if not creep.weights.size:
        return positions
    before = float(positions[0] if from_rest else np.mean(positions))
    quick = before / (1.0 + float(np.sum(creep.weights)))
    lags = np.full(creep.weights.size, quick)
    return remove_creep(creep.at(period_s), positions, lags, quick)
