"""A record with its ranges, and the parts of the fit of stop operators to it."""

import numpy as np

from piezod.control.law.creep import NO_CREEP, logarithmic
from piezod.control.law.model import StageModel
from piezod.experiment.fit.delay import DelayEstimate, estimate_delay
from piezod.experiment.fit.least_squares import (
    LeastSquaresFit,
    Series,
    fit_least_squares,
)
from piezod.experiment.fit.lms_passes import repeated_lms
from piezod.experiment.fit.method import Spacing
from piezod.experiment.fit.problem import LinearProblem, Problem
from piezod.experiment.fit.record import Rows
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


class StopProblem(Problem):
    """A record with its ranges, and the parts of the fit of stop operators."""

    def without(
        self, model: StageModel, linearised: LinearProblem | None, held_out: Rows
    ) -> StageModel:
        """Return the model of the record without some samples, as `Problem.without`."""
        assert isinstance(model.form, StopForm)  # noqa: S101 - this problem makes no other
        bank, delay_s = model.form.bank, model.delay_s
        if linearised is None:
            return self.model(bank, self.lms(bank, delay_s, held_out), 0.0, delay_s)
        parameters = linearised.solved(linearised.counted & ~held_out)
        weights, creep = np.split(parameters, [bank.shape[1]])
        return self.model(bank, weights, float(np.sum(creep)), delay_s)

    def series(self, delay_s: float) -> Series:
        """Return the normalised record, with each displacement beside its voltage."""
        record = self.record
        return Series(
            positions=self.position_um.to_unit(record.position_um),
            drives=self.drive_v.to_unit(record.drive_delayed_by(delay_s)),
            period_s=record.period_s,
            from_rest=record.from_rest,
            counted=record.counted(delay_s),
            after_run_in=record.counted(),
        )

    def delay(self, bank: FloatArray, creep: float) -> tuple[DelayEstimate | None, float]:
        """Return the delay, estimated with this weight of each lag if it was not given."""
        if self._settings.delay_s is not None:
            return None, self._settings.delay_s
        y = self.series(0.0).quick(creep)
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
        _, delay_s = self.delay(fine, 0.0)
        return placed_thresholds(fine, self.least_squares(fine, delay_s).weights, order)

    def least_squares(self, bank: FloatArray, delay_s: float) -> LeastSquaresFit:
        """Return the weights, and the creep if it is set, all at once."""
        return fit_least_squares(bank, self.series(delay_s), creep=bool(self._settings.creep))

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
        self, bank: FloatArray, weights: FloatArray, creep: float, delay_s: float
    ) -> StageModel:
        """Return the model of normalised parameters, in V and µm."""
        quick = self.series(delay_s).range_of(creep)
        return StageModel(
            StopForm(bank),
            weights,
            self.drive_v,
            # [0, 1] is then the range of the displacement without creep.
            AffineRange.checked(*map(self.position_um.from_unit, quick)),
            delay_s,
            logarithmic(creep) if creep else NO_CREEP,
        )
