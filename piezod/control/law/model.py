"""What is known of a stage: its inverse model, with the ranges, the creep and the delay."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.control.law.creep import NO_CREEP, CreepLaw
from piezod.errors import DataError
from piezod.hysteresis import AffineRange, InverseMPI
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
