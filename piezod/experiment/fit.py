"""From a record of drive and displacement to an inverse model of the stage, with its delay."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.errors import DataError
from piezod.experiment.delay import DelayEstimate, estimate_delay
from piezod.experiment.method import Method
from piezod.experiment.record import Record
from piezod.hysteresis import (
    AffineRange,
    InverseMPI,
    LMSIdentifier,
    even_thresholds,
    identify_least_squares,
    largest_stable_gain,
    new_bank,
    stop_regressors,
)
from piezod.hysteresis.memory import FloatArray

REST_BEYOND = 0.01
"""The rest voltage may leave a model's voltages by this part of them."""
PAPER_GAIN = 0.1
"""γ of the paper."""
LMS_PASSES = 3
"""The paper: the procedure "can be repeated for several times until satisfactory"."""


@dataclass(frozen=True)
class StageModel:
    """An identified inverse model with the ranges and the delay that it holds for.

    Attributes:
        bank: (2, 2 M) thresholds and gains of the stops.
        weights: (2 M,) weights [a^l, a^r].
        drive_v: Range of the drive that is [0, 1], in V.
        position_um: Range of the displacement that is [0, 1], in µm.
        delay_s: How long the displacement lags behind the voltage, in s.
    """

    bank: FloatArray
    weights: FloatArray
    drive_v: AffineRange
    position_um: AffineRange
    delay_s: float

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

    def predicted_v(self, record: Record, deadband: float = 0.0) -> FloatArray:
        """Return the voltage that the model needs for a recorded displacement, in V, shape (n,).

        Args:
            record: What was measured; the memory starts relaxed at its first sample.
            deadband: Width of the backlash before the memory, in units of the range.
        """
        x = _unit_positions(self.position_um, record)
        return self.drive_v.from_unit(x + stop_regressors(self.bank, x, deadband) @ self.weights)

    def errors_pct(self, record: Record, deadband: float = 0.0) -> dict[str, float]:
        """Return worst and rms error of the predicted voltage, in % of the voltage's range."""
        aligned = record.aligned(self.delay_s)
        error_v = self.predicted_v(aligned, deadband) - aligned.drive_v
        error_pct = 100.0 * error_v / self.drive_v.width
        return {
            "voltage_error_max_pct": float(np.max(np.abs(error_pct))),
            "voltage_error_rms_pct": float(np.sqrt(np.mean(error_pct**2))),
        }


@dataclass(frozen=True)
class Fit:
    """A model and how it came about.

    Attributes:
        model: The model.
        method: How its weights were found.
        delay: The estimate of the delay, None where the delay was given.
        smallest_slope: The smallest slope of the inverse anywhere; it is monotone if positive.
    """

    model: StageModel
    method: Method
    delay: DelayEstimate | None
    smallest_slope: float


def _unit_positions(position_um: AffineRange, record: Record) -> FloatArray:
    """Return recorded displacements normalised and clamped to [0, 1], shape (n,)."""
    return np.clip(position_um.to_unit(record.position_um), 0.0, 1.0)


def fit_model(
    record: Record,
    *,
    method: Method,
    order: int = 19,
    lms_gain: float | None = None,
    deadband: float = 0.0,
    delay_s: float | None = None,
) -> Fit:
    """Fit an inverse model to a record.

    The ranges of the record become [0, 1] (eqs 27 and 28), so that what is driven later must lie
    within them.

    Args:
        record: Drive and displacement.
        method: How to find the weights.
        order: Operators on each side, M.
        lms_gain: γ, for LMS; None for the paper's, or a stable one where that is not.
        deadband: Width of the backlash before the memory, in units of the range.
        delay_s: The delay in s; estimated from the record if None.

    Raises:
        DataError: If the record is too short, constant, or does not grow with the drive.
        ModelError: If the gain of LMS is not stable for so many operators.
    """
    _check(record, 2 * order)
    bank = new_bank(even_thresholds(order), even_thresholds(order))
    drive_v = AffineRange.checked(float(record.drive_v.min()), float(record.drive_v.max()))
    position_um = AffineRange.checked(
        float(record.position_um.min()), float(record.position_um.max())
    )
    estimate = None
    if delay_s is None:
        x = _unit_positions(position_um, record)
        estimate = estimate_delay(record, stop_regressors(bank, x, deadband), x, drive_v)
        delay_s = estimate.delay_s
    aligned = record.aligned(delay_s)
    _check(aligned, 2 * order)
    x, v = _unit_positions(position_um, aligned), drive_v.to_unit(aligned.drive_v)
    if method is Method.LMS:
        weights = _lms_weights(bank, x, v, lms_gain, deadband)
    else:
        weights = identify_least_squares(bank, x, v, deadband=deadband)
    model = StageModel(bank, weights, drive_v, position_um, delay_s)
    return Fit(model, method, estimate, model.inverse().smallest_slope)


def _check(record: Record, n_weights: int) -> None:
    fewest = SAMPLES_PER_WEIGHT * n_weights
    if record.t_s.size < fewest:
        raise DataError(
            f"{record.t_s.size} samples are left for {n_weights} weights; allowed are {fewest} or "
            "more; record for longer, skip less, or fit fewer operators"
        )
    scaled = []
    for name, values in (("drive_v", record.drive_v), ("position_um", record.position_um)):
        low, high = float(values.min()), float(values.max())
        if low == high:
            raise DataError(f"{name} is {low:g} throughout; allowed is a signal that varies")
        scaled.append(AffineRange.checked(low, high).to_unit(values))
    correlation = float(np.corrcoef(scaled[0], scaled[1])[0, 1])
    if correlation <= 0.0:
        raise DataError(
            "position_um does not grow with the drive: its correlation with drive_v is "
            f"{correlation:.2f}; allowed is above 0; change the sign of one of them where the "
            "sensor counts the other way, else check that the sensor is the one of this drive"
        )


def _lms_weights(
    bank: FloatArray, x: FloatArray, v: FloatArray, gain: float | None, deadband: float
) -> FloatArray:
    if gain is None:
        gain = min(PAPER_GAIN, 0.9 * largest_stable_gain(bank))
    identifier = LMSIdentifier(bank, gain=gain, deadband=deadband)
    for _ in range(LMS_PASSES):
        identifier.reset()
        identifier.run(x, v)
    return identifier.weights
