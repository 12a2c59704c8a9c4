"""From a record of drive and displacement to an inverse model of the stage, with its delay."""

from dataclasses import dataclass

import numpy as np

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.errors import DataError
from piezod.experiment.creep_law import NO_CREEP, logarithmic
from piezod.experiment.delay import DelayEstimate, estimate_delay
from piezod.experiment.least_squares_fit import Linearised, Series, Slow, fit_least_squares
from piezod.experiment.method import Method, Spacing
from piezod.experiment.record import Record
from piezod.experiment.smoothing import longest_window, smoothed_record
from piezod.experiment.stage_model import StageModel
from piezod.hysteresis import (
    AffineRange,
    LMSIdentifier,
    even_thresholds,
    graded_thresholds,
    largest_stable_gain,
    new_bank,
    placed_thresholds,
    stop_regressors,
)
from piezod.hysteresis.memory import FloatArray

PAPER_GAIN = 0.1
"""γ of the paper."""
LMS_PASSES = 3
"""The paper: the procedure "can be repeated for several times until satisfactory"."""
FINE_ORDER = 40
"""Operators of the fit that tells where thresholds are needed."""


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """How a model is fitted.

    Attributes:
        method: How to find the weights.
        order: Operators on each side, M.
        spacing: Where their thresholds are.
        creep: Whether creep is fitted too; by least squares only.
        lms_gain: γ, for LMS; None for the paper's, or a stable one where that is not.
        deadband: Width of the backlash before the memory, in units of the range, for LMS; least
            squares sees a smoothed displacement and needs none.
        delay_s: The delay in s; estimated from the record if None.
        run_in_s: The first seconds of the record, which do not count: the stage settles in them.
        from_rest: Whether the stage had rested where the record begins.
    """

    method: Method = Method.LEAST_SQUARES
    order: int = 19
    spacing: Spacing = Spacing.EVEN
    creep: bool = False
    lms_gain: float | None = None
    deadband: float = 0.0
    delay_s: float | None = None
    run_in_s: float = 0.0
    from_rest: bool = True


@dataclass(frozen=True)
class Fit:
    """A model and how it came about.

    Attributes:
        model: The model.
        settings: How it was asked for.
        delay: The estimate of the delay, None where the delay was given.
        smallest_slope: The smallest slope of the inverse anywhere; it is monotone if positive.
        smoothing: Samples under each parabola that took the noise out of the displacement.
        linearised: The problem around the solution; None for LMS.
    """

    model: StageModel
    settings: FitSettings
    delay: DelayEstimate | None
    smallest_slope: float
    smoothing: int
    linearised: Linearised | None

    def predicted_v(self, record: Record) -> FloatArray:
        """Return the voltage predicted from a record that is seen as by the fit, shape (n,)."""
        return self.model.predicted_v(
            smoothed_record(record, self.smoothing),
            self.settings.deadband if self.settings.method is Method.LMS else 0.0,
            from_rest=self.settings.from_rest,
        )

    def errors_pct(self, record: Record) -> dict[str, float]:
        """Return worst and rms error of the predicted voltage, in % of the voltage's range.

        Args:
            record: The record of the fit, or one like it; its run-in does not count.
        """
        answers_v = record.drive_delayed_by(self.model.delay_s)
        start_s = max(self.model.delay_s, self.settings.run_in_s)
        counted = record.t_s - record.t_s[0] >= start_s
        error_v = (self.predicted_v(record) - answers_v)[counted]
        error_pct = 100.0 * error_v / self.model.drive_v.width
        return {
            "voltage_error_max_pct": float(np.max(np.abs(error_pct))),
            "voltage_error_rms_pct": float(np.sqrt(np.mean(error_pct**2))),
        }


def fit_model(record: Record, settings: FitSettings) -> Fit:
    """Fit an inverse model to a record.

    The ranges of the record become [0, 1] (eqs 27 and 28), so that what is driven later must lie
    within them.

    Args:
        record: Drive and displacement.
        settings: How.

    Raises:
        DataError: If the record is too short, constant, or does not grow with the drive.
        ModelError: If the gain of LMS is not stable for so many operators.
    """
    _check(record, 2 * settings.order)
    smoothing = 1 if settings.method is Method.LMS else longest_window(record.drive_v)
    ranged = _Ranged(smoothed_record(record, smoothing), settings)
    bank = ranged.bank()
    estimate, delay_s = ranged.delay(bank, Slow())
    series = ranged.series(delay_s)
    if settings.method is Method.LMS:
        weights, slow, linearised = _lms_weights(bank, series, settings), Slow(), None
    else:
        weights, slow, linearised = fit_least_squares(bank, series, creep=settings.creep)
        if settings.creep:  # which had looked like a longer delay
            estimate, delay_s = ranged.delay(bank, slow)
            series = ranged.series(delay_s)
            weights, slow, linearised = fit_least_squares(bank, series, creep=True)
    model = StageModel(
        bank,
        weights,
        ranged.drive_v,
        ranged.position_um_of(slow),
        delay_s,
        logarithmic(slow.creep) if slow.creep else NO_CREEP,
    )
    slope = model.inverse().smallest_slope
    return Fit(model, settings, estimate, slope, smoothing, linearised)


class _Ranged:
    """A record with its ranges, and what a fit asks of both.

    Args:
        record: Drive and displacement.
        settings: How to fit.
    """

    def __init__(self, record: Record, settings: FitSettings) -> None:
        self._record, self._settings = record, settings
        self.drive_v = _range_of(record.drive_v)
        self._position_um = _range_of(record.position_um)

    def series(self, delay_s: float) -> Series:
        """Return the record normalised, each displacement beside its voltage."""
        aligned = self._record.aligned(delay_s)
        _check(aligned, 2 * self._settings.order)
        return Series(
            positions=self._position_um.to_unit(aligned.position_um),
            drives=self.drive_v.to_unit(aligned.drive_v),
            period_s=aligned.period_s,
            from_rest=self._settings.from_rest,
            counted=aligned.t_s - self._record.t_s[0] >= self._settings.run_in_s,
        )

    def delay(self, bank: FloatArray, slow: Slow) -> tuple[DelayEstimate | None, float]:
        """Return the delay, estimated where it was not given, by a stage that is slow like this."""
        if self._settings.delay_s is not None:
            return None, self._settings.delay_s
        y = np.clip(self.series(0.0).quick(slow), 0.0, 1.0)
        estimate = estimate_delay(self._record, stop_regressors(bank, y), y, self.drive_v)
        return estimate, estimate.delay_s

    def bank(self) -> FloatArray:
        """Return the stops, with their thresholds where the settings want them."""
        order, spacing = self._settings.order, self._settings.spacing
        if spacing is Spacing.EVEN:
            thresholds = even_thresholds(order)
            return new_bank(thresholds, thresholds)
        if spacing is Spacing.GRADED:
            thresholds = graded_thresholds(order)
            return new_bank(thresholds, thresholds)
        fine = new_bank(graded_thresholds(FINE_ORDER), graded_thresholds(FINE_ORDER))
        _, delay_s = self.delay(fine, Slow())
        weights = fit_least_squares(fine, self.series(delay_s), creep=self._settings.creep).weights
        return placed_thresholds(fine, weights, order)

    def position_um_of(self, slow: Slow) -> AffineRange:
        """Return the range that is [0, 1] for y, the displacement that does not creep."""
        width_um = self._position_um.width / (1.0 + slow.stretch)
        low_um = self._position_um.low + slow.offset * width_um
        return AffineRange.checked(low_um, low_um + width_um)


def _range_of(values: FloatArray) -> AffineRange:
    return AffineRange.checked(float(values.min()), float(values.max()))


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


def _lms_weights(bank: FloatArray, series: Series, settings: FitSettings) -> FloatArray:
    gain = settings.lms_gain
    if gain is None:
        gain = min(PAPER_GAIN, 0.9 * largest_stable_gain(bank))
    identifier = LMSIdentifier(bank, gain=gain, deadband=settings.deadband)
    for _ in range(LMS_PASSES):
        identifier.reset()
        identifier.run(np.clip(series.positions, 0.0, 1.0), series.drives)
    return identifier.weights
