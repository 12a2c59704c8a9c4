"""Fits an inverse model, with the delay, to a record of drive and displacement."""

from dataclasses import dataclass, field

import numpy as np

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.control.law.creep import NO_CREEP, logarithmic
from piezod.control.law.model import StageModel
from piezod.errors import DataError
from piezod.experiment.fit.delay import DelayEstimate, estimate_delay, has_one_frequency
from piezod.experiment.fit.least_squares import (
    LeastSquaresFit,
    Series,
    SlowParameters,
    fit_least_squares,
    search_slow_parameters,
)
from piezod.experiment.fit.lms_passes import repeated_lms
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.prediction import predicted_v
from piezod.experiment.fit.problem import LinearProblem, Problem
from piezod.experiment.fit.record import Record, Rows
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.surface_problem import SurfaceProblem
from piezod.hysteresis import (
    AffineRange,
    StopForm,
    even_thresholds,
    graded_thresholds,
    new_bank,
    placed_thresholds,
    stop_regressors,
)
from piezod.hysteresis.memory import FloatArray

FINE_ORDER = 40
"""Operators of the first fit, which shows where thresholds are needed."""


@dataclass(frozen=True)
class Fit:
    """A model, and its fit.

    Attributes:
        model: The model.
        settings: Settings of the fit.
        delay: Estimate of the delay, None if the delay was given.
        smallest_slope: Smallest slope of the model; it is monotone if positive.
        problem: The problem that was solved.
        linearised: The problem, linear around the solution; None for LMS.
    """

    model: StageModel
    settings: FitSettings
    delay: DelayEstimate | None
    smallest_slope: float
    problem: Problem = field(repr=False)
    linearised: LinearProblem | None = field(repr=False)

    @property
    def record(self) -> Record:
        """The record of the fit, smoothed if `smoothing` is set."""
        return self.problem.record

    def as_fitted(self, record: Record) -> Record:
        """Return another record as this fit uses it: smoothed, if `smoothing` is set."""
        return self.settings.as_fitted(record)

    def without(self, held_out: Rows) -> StageModel:
        """Return the model of the same record without some samples, shape (n,).

        These samples advance memory and creep, as a run-in does. Ranges, thresholds and delay are
        those of the whole record. The problem is the one that is linear around its solution.
        """
        return self.problem.without(self.model, self.linearised, held_out)

    def predicted_v(self, record: Record, model: StageModel | None = None) -> FloatArray:
        """Return the voltage predicted from a record, in V, shape (n,).

        Args:
            record: Any record of the stage, prepared by `as_fitted`.
            model: Another model than that of the fit.
        """
        deadband = self.settings.deadband if self.settings.method is Method.LMS else 0.0
        return predicted_v(model or self.model, record, deadband)

    def residuals_pct(self, record: Record, model: StageModel | None = None) -> FloatArray:
        """Return predicted minus actual voltage of the samples that count, shape (k,).

        In % of the range of the voltage in the record of the fit. The arguments are those of
        `predicted_v`.
        """
        delay_s = self.model.delay_s
        # Predictions are compared at the instants of the samples, with the voltage one delay
        # before.
        error_v = self.predicted_v(record, model) - record.drive_delayed_by(delay_s)
        return 100.0 * error_v[record.counted(delay_s)] / self.model.drive_v.width

    def errors_pct(self, record: Record) -> dict[str, float]:
        """Return worst and rms error of the predicted voltage, in % of the voltage's range.

        Args:
            record: The record of the fit, or a similar one; its run-in does not count.
        """
        return errors_of(self.residuals_pct(self.as_fitted(record)))


def errors_of(residuals_pct: FloatArray) -> dict[str, float]:
    """Return the worst and the rms residual, by name.

    Args:
        residuals_pct: (k,) residuals, in %.
    """
    return {
        "voltage_error_max_pct": float(np.max(np.abs(residuals_pct))),
        "voltage_error_rms_pct": float(np.sqrt(np.mean(residuals_pct**2))),
    }


def fit_model(record: Record, settings: FitSettings) -> Fit:
    """Fit an inverse model to a record.

    The ranges of the record become [0, 1], paper eq. (27) and eq. (28). Later drives must stay
    within them.

    Args:
        record: Drive and displacement.
        settings: Settings of the fit.

    Raises:
        DataError: If the record is too short or constant, or does not grow with the drive.
        ModelError: If the gain of LMS is not stable for this number of operators.
    """
    _check(record, settings)
    if settings.method is Method.SURFACE:
        return _fit_surface(record, settings)
    problem = FitProblem(settings.as_fitted(record), settings)
    bank, slow_parameters, linearised = problem.bank(), SlowParameters(), None
    # Creep looks like a delay, so both are searched together. With one frequency they cannot be
    # separated.
    if settings.creep and settings.delay_s is None and not has_one_frequency(record.drive_v):
        slow_parameters = search_slow_parameters(bank, problem.series)
    estimate, delay_s = problem.delay(bank, slow_parameters)
    if settings.method is Method.LMS:
        weights = problem.lms(bank, delay_s)
    else:
        weights, slow_parameters, linearised = problem.least_squares(bank, delay_s)
    model = problem.model(bank, weights, slow_parameters, delay_s)
    slope = model.form.smallest_slope(model.weights)
    return Fit(model, settings, estimate, slope, problem, linearised)


def _fit_surface(record: Record, settings: FitSettings) -> Fit:
    problem = SurfaceProblem(settings.as_fitted(record), settings)
    start_s = settings.delay_s
    if start_s is None:
        stops = FitProblem(problem.record, settings)
        even = even_thresholds(settings.order)
        estimate, start_s = stops.delay(new_bank(even, even), SlowParameters())
    one_frequency = has_one_frequency(record.drive_v)
    linearised = problem.solve(start_s, search_delay=settings.delay_s is None and not one_frequency)
    model = problem.model(linearised.parameters)
    if settings.delay_s is not None:
        estimate = None
    elif not one_frequency:
        estimate = problem.delay(linearised)
    slope = model.form.smallest_slope(model.weights)
    return Fit(model, settings, estimate, slope, problem, linearised)


class FitProblem:
    """A record with its ranges, and the parts of its fit.

    Args:
        record: Drive and displacement, prepared for the method.
        settings: Settings of the fit.
    """

    def __init__(self, record: Record, settings: FitSettings) -> None:
        counted = record.counted()
        self._record, self._settings = record, settings
        self.drive_v = _range_of(record.drive_v[counted])
        self._position_um = _range_of(record.position_um[counted])

    @property
    def record(self) -> Record:
        """The record, prepared for the method."""
        return self._record

    def without(
        self, model: StageModel, linearised: LinearProblem | None, held_out: Rows
    ) -> StageModel:
        """Return the model of the record without some samples, as `Problem.without`."""
        assert isinstance(model.form, StopForm)  # noqa: S101 - this problem makes no other
        bank, delay_s = model.form.bank, model.delay_s
        if linearised is None:
            return self.model(bank, self.lms(bank, delay_s, held_out), SlowParameters(), delay_s)
        parameters = linearised.solved(linearised.counted & ~held_out)
        weights, slow = np.split(parameters, [bank.shape[1]])
        return self.model(bank, weights, SlowParameters(*slow), delay_s)

    def series(self, delay_s: float) -> Series:
        """Return the normalised record, with each displacement beside its voltage."""
        record = self.record
        return Series(
            positions=self._position_um.to_unit(record.position_um),
            drives=self.drive_v.to_unit(record.drive_delayed_by(delay_s)),
            period_s=record.period_s,
            from_rest=record.from_rest,
            counted=record.counted(delay_s),
        )

    def delay(
        self, bank: FloatArray, slow_parameters: SlowParameters
    ) -> tuple[DelayEstimate | None, float]:
        """Return the delay, estimated with these slow parameters if it was not given."""
        if self._settings.delay_s is not None:
            return None, self._settings.delay_s
        # The operators are defined on [0, 1].
        y = np.clip(self.series(0.0).quick(slow_parameters), 0.0, 1.0)
        estimate = estimate_delay(self.record, stop_regressors(bank, y), y, self.drive_v)
        return estimate, estimate.delay_s

    def bank(self) -> FloatArray:
        """Return the stops, with thresholds as in the settings."""
        order, spacing = self._settings.order, self._settings.spacing
        if spacing is Spacing.EVEN:
            thresholds = even_thresholds(order)
            return new_bank(thresholds, thresholds)
        if spacing is Spacing.GRADED:
            thresholds = graded_thresholds(order)
            return new_bank(thresholds, thresholds)
        fine = new_bank(graded_thresholds(FINE_ORDER), graded_thresholds(FINE_ORDER))
        _, delay_s = self.delay(fine, SlowParameters())
        return placed_thresholds(fine, self.least_squares(fine, delay_s).weights, order)

    def least_squares(self, bank: FloatArray, delay_s: float) -> LeastSquaresFit:
        """Return the weights, and the slow parameters if `creep` is set, all at once."""
        return fit_least_squares(bank, self.series(delay_s), creep=self._settings.creep)

    def lms(self, bank: FloatArray, delay_s: float, held_out: Rows | None = None) -> FloatArray:
        """Return the weights [a^l, a^r] by the update of paper eq. (29), shape (2 M,).

        Args:
            bank: (2, 2 M) thresholds and gains of the stops.
            delay_s: Delay, in s.
            held_out: (n,) samples that are not learned from; none by default.
        """
        series, settings = self.series(delay_s), self._settings
        learned = series.counted if held_out is None else series.counted & ~held_out
        drives = np.where(learned, series.drives, np.nan)  # NaN advances the memory only
        return repeated_lms(bank, series.positions, drives, settings.lms_gain, settings.deadband)

    def model(
        self, bank: FloatArray, weights: FloatArray, slow_parameters: SlowParameters, delay_s: float
    ) -> StageModel:
        """Return the model of normalised parameters, in V and µm."""
        # [0, 1] is then the range of y, the displacement without creep.
        width_um = self._position_um.width / (1.0 + slow_parameters.stretch)
        low_um = self._position_um.low + slow_parameters.offset * width_um
        return StageModel(
            StopForm(bank),
            weights,
            self.drive_v,
            AffineRange.checked(low_um, low_um + width_um),
            delay_s,
            logarithmic(slow_parameters.creep) if slow_parameters.creep else NO_CREEP,
        )


def _range_of(values: FloatArray) -> AffineRange:
    return AffineRange.checked(float(values.min()), float(values.max()))


def _check(record: Record, settings: FitSettings) -> None:
    delay_s, n_weights = settings.delay_s or 0.0, settings.n_weights
    counted, fewest = record.counted(delay_s), SAMPLES_PER_WEIGHT * n_weights
    drive_v = record.drive_delayed_by(delay_s)[counted]
    position_um = record.position_um[counted]
    if drive_v.size < fewest:
        surface = settings.method is Method.SURFACE
        remedy = "or skip less" if surface else "skip less, or fit fewer operators"
        raise DataError(
            f"{drive_v.size} samples are left for {n_weights} weights; allowed are {fewest} or "
            f"more; record for longer, {remedy}"
        )
    scaled = []
    for name, values in (("drive_v", drive_v), ("position_um", position_um)):
        low, high = float(values.min()), float(values.max())
        if low == high:
            raise DataError(f"{name} is {low:g} throughout; allowed is a signal that varies")
        scaled.append(AffineRange.checked(low, high).to_unit(values))
    correlation = float(np.corrcoef(scaled[0], scaled[1])[0, 1])
    if correlation <= 0.0:
        raise DataError(
            "position_um does not grow with the drive: its correlation with drive_v is "
            f"{correlation:.2f}; allowed is above 0; change the sign of one of them if the "
            "sensor counts in the other direction, else check that it is the sensor of this drive"
        )
