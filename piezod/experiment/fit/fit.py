"""Fits an inverse model, with the delay, to a record of drive and displacement."""

from dataclasses import dataclass, field, replace

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.control.law.model import StageModel
from piezod.errors import DataError
from piezod.experiment.fit.delay import DelayEstimate, has_one_frequency
from piezod.experiment.fit.excitation import shows_creep
from piezod.experiment.fit.least_squares import search_creep
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.prediction import predicted_um, predicted_v
from piezod.experiment.fit.problem import LinearProblem, Problem
from piezod.experiment.fit.record import Record, Rows, check_varies
from piezod.experiment.fit.residuals import Residuals
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.stop_problem import StopProblem
from piezod.experiment.fit.surface.first_mode import ShownMode
from piezod.experiment.fit.surface.search import search_surface
from piezod.hysteresis import SurfaceForm
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation


@dataclass(frozen=True)
class Fit:
    """A model, and its fit."""

    model: StageModel  #: The model.
    settings: FitSettings  #: Settings of the fit.
    delay: DelayEstimate | None  #: Estimate of the delay, None if the delay was given.
    smallest_slope: float  #: Smallest slope of the model; it is monotone if positive.
    problem: Problem = field(repr=False)  #: The problem that was solved.
    #: The problem, linear around the solution; None for LMS.
    linearised: LinearProblem | None = field(repr=False)
    recorded: Record = field(repr=False)  #: The record of the fit, never smoothed.
    #: How clearly the record shows the first mode; None if the model has none.
    shows_mode: ShownMode | None = None

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

    @property
    def rate_lag(self) -> float:
        """Growth of the lag per e-fold of the drive's rate, as a share of the drive's range."""
        form = self.model.form
        return form.activation if isinstance(form, SurfaceForm) else 0.0

    @property
    def path(self) -> PathRelaxation | None:
        """Part of the displacement that relaxes along the path of the drive, None without it."""
        form = self.model.form
        return form.path if isinstance(form, SurfaceForm) else None

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

    def position_residuals_pct(self, record: Record, model: StageModel | None = None) -> FloatArray:
        """Return predicted minus recorded position of the samples that count, shape (k,).

        In % of the range of the position in the model of the fit. The position is predicted from
        the voltage alone. The arguments are those of `residuals_pct`.
        """
        error_um = predicted_um(model or self.model, record) - record.position_um
        counted = record.counted(self.model.delay_s)
        return 100.0 * error_um[counted] / self.model.position_um.width

    def residuals(self, record: Record, model: StageModel | None = None) -> Residuals:
        """Return the residuals of voltage and position; the arguments are the same."""
        return Residuals(
            self.residuals_pct(record, model), self.position_residuals_pct(record, model)
        )

    def errors_pct(self, record: Record) -> dict[str, float]:
        """Return worst and rms errors of the predicted voltage and position, in % of the ranges.

        Args:
            record: The record of the fit, or a similar one; its run-in does not count.
        """
        return self.residuals(self.as_fitted(record)).errors


def fit_model(record: Record, settings: FitSettings) -> Fit:
    """Fit an inverse model to a record.

    The ranges of the record become [0, 1], paper eq. (27) and eq. (28). Later drives must stay
    within them.

    Raises:
        DataError: If the record is too short or constant.
        ModelError: If the gain of LMS is not stable for this number of operators.
    """
    _check(record, settings)
    if settings.creep is None:
        settings = replace(settings, creep=shows_creep(record))
    if settings.method is Method.SURFACE:
        return _fit_surface(record, settings)
    problem = StopProblem(settings.as_fitted(record), settings)
    bank, creep, linearised = problem.bank(), 0.0, None
    # Creep looks like a delay, so both are searched together. With one frequency they cannot be
    # separated.
    if settings.creep and settings.delay_s is None and not has_one_frequency(record.drive_v):
        creep = search_creep(bank, problem.series)
    estimate, delay_s = problem.delay(bank, creep)
    if settings.method is Method.LMS:
        weights = problem.lms(bank, delay_s)
    else:
        weights, creep, linearised = problem.least_squares(bank, delay_s)
    model = replace(problem.model(bank, weights, creep, delay_s), held_s=record.held_s)
    slope = model.form.smallest_slope(model.weights)
    return Fit(model, settings, estimate, slope, problem, linearised, record)


def _fit_surface(record: Record, settings: FitSettings) -> Fit:
    estimate, start_s, smoothed = None, settings.delay_s, settings.as_fitted(record)
    if start_s is None:
        stops = StopProblem(smoothed, replace(settings, spacing=Spacing.GRADED))
        estimate, start_s = stops.delay(stops.bank(), 0.0)
    one_frequency = has_one_frequency(record.drive_v)
    found = search_surface(record, settings, start_s, one_frequency=one_frequency)
    problem, linearised = found.problem, found.linearised
    if estimate is not None and not one_frequency:
        estimate = problem.delay(linearised)
    model = replace(problem.model(linearised.parameters), held_s=record.held_s)
    slope = model.form.smallest_slope(model.weights)
    return Fit(
        model, found.settings, estimate, slope, problem, linearised, record, found.shows_mode
    )


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
    check_varies(drive_v, position_um)
