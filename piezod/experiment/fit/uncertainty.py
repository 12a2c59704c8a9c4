"""Uncertainty of the numbers of a model, as far as its record determines them.

Two causes are told apart. Noise makes the numbers scatter from record to record of the same drive.
What the model cannot describe makes them depend on the drive: that shows in the models of the
blocks, each of which lacks a part of it.
"""

from dataclasses import dataclass, replace

import numpy as np

from piezod.control.law.first_mode import FirstMode
from piezod.experiment.fit.errors import CrossValidation
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.problem import LinearProblem
from piezod.experiment.fit.spectrum import noise_density_of
from piezod.experiment.fit.surface.gauss_newton import LinearisedSurface
from piezod.experiment.fit.surface.parameters import DELAY, MODE
from piezod.hysteresis.memory import FloatArray

SIGMAS_95 = 1.96
"""Half width of a 95 % interval, in standard errors."""
BATCHES = 20
MODE_COVERAGE = 2.0
"""Ratio of the deviation of a found mode from the true one, and of the standard error that follows
from the residuals. Amplifier and sensor are no lag of first order exactly, which no residual shows.
Measured on 20 specimens: `python -m benchmarks.ringing --seeds`."""

SURFACE_COVERAGE, OPERATOR_COVERAGE = 1.5, 8.0
"""Ratio of the scatter of delay and creep over repeats, and of the standard error that follows from
the noise: a search does not end exactly at the best fit, and the noise of the displacement is in
the stops, too, and turns them. Measured, with a reserve: `test_stated_errors_are_those_of_repeats`.
"""


@dataclass(frozen=True)
class Uncertainty:
    """Half widths of 95 % intervals, and the scatter over the blocks.

    Those of delay, creep and mode are due to the noise of the record alone. That of the predicted
    voltage follows from all residuals.
    """

    delay_s: float | None  #: Half width of the delay, in s; None if the delay was given.
    #: Number of uncorrelated samples with the same information as the record; None for LMS, like
    #: the next two.
    independent_samples: float | None
    creep_per_decade: float | None  #: Half width of the creep, as a share of a step.
    #: (k,) half width of the voltage predicted from each sample that the fit counted, in % of its
    #: range.
    band_pct: FloatArray | None
    spread_pct: (
        FloatArray  #: (k,) standard deviation of that voltage over the models of the blocks.
    )
    block_creep_per_decade: tuple[float, ...]  #: Creep in the models of the blocks.
    block_delay_s: tuple[float, ...]  #: Delay in them, in s; stops have that of the whole record.
    #: Half widths of the parameters of the first mode; None without one.
    mode: FirstMode | None = None


def uncertainty_of(fit: Fit, validation: CrossValidation) -> Uncertainty:
    """Return the uncertainty of a fit."""
    models = [block.model for block in validation.blocks]
    predicted_pct = np.stack([fit.residuals_pct(fit.record, model) for model in models])
    samples, creep, band_pct, mode, by_noise = None, None, None, None, None
    noise = 1e-4 * noise_density_of(fit.position_residuals_pct(fit.recorded))
    if fit.linearised:
        samples, covariance = covariance_of(fit.linearised)
        rows = fit.linearised.regressors[fit.linearised.counted]
        # Variance of each prediction, row by row: x C x.
        variance = np.einsum("ki,ij,kj->k", rows, covariance, rows, optimize=True)
        changes = fit.linearised.drive_changes[fit.linearised.counted]
        band_pct = 100.0 * SIGMAS_95 * changes * np.sqrt(np.maximum(variance, 0.0))
        surface = isinstance(fit.linearised, LinearisedSurface)
        wider = SURFACE_COVERAGE if surface else OPERATOR_COVERAGE
        by_noise = _with_delay(fit, fit.linearised).covariance(wider**2 * noise)
        creep = _creep_error(fit.linearised, by_noise)
        if fit.model.mode is not None:
            mode = _mode_error(by_noise, fit.record.period_s)
    return Uncertainty(
        delay_s=_delay_error(fit, by_noise),
        independent_samples=samples,
        creep_per_decade=creep,
        band_pct=band_pct,
        spread_pct=np.std(predicted_pct, axis=0, ddof=1),
        block_creep_per_decade=tuple(model.creep.per_decade for model in models),
        block_delay_s=tuple(model.delay_s for model in models),
        mode=mode,
    )


def covariance_of(linearised: LinearProblem) -> tuple[float, FloatArray]:
    """Return the number of independent samples, and the covariance of the parameters, (p, p).

    Neighbouring residuals are correlated, so that they contain less information than their number
    suggests. Batches of the record show how much the variance of predictions is larger: for
    independent residuals, the sums of regressor times residual over a batch would be small (Liang
    and Zeger 1986, averaged here over all directions).
    """
    rows = linearised.regressors[linearised.counted]
    misses = linearised.misses[linearised.counted]
    n_samples, n_parameters = rows.shape
    variance = float(np.mean(misses**2))
    per_variance = linearised.covariance(1.0)
    # Contiguous batches keep the correlation of neighbouring residuals within a batch.
    starts = np.linspace(0, n_samples, BATCHES, endpoint=False).astype(np.int64)
    sums = np.add.reduceat(rows * misses[:, np.newaxis], starts, axis=0)
    observed = float(np.einsum("bi,ij,bj->", sums, per_variance, sums, optimize=True))
    # At least 1: batches must not make the model look better than independent samples would.
    inflation = max(observed / (n_parameters * variance), 1.0) if variance > 0.0 else 1.0
    return n_samples / inflation, variance * inflation * per_variance


def _with_delay(fit: Fit, linearised: LinearProblem) -> LinearProblem:
    """Return the problem in which a delay that was estimated is a parameter, behind all others.

    Creep and delay are searched together: noise in one is noise in the other. That of a surface has
    the delay already.
    """
    if isinstance(linearised, LinearisedSurface) or fit.delay is None or fit.delay.one_frequency:
        return linearised
    drives = fit.model.drive_v.to_unit(fit.record.drive_delayed_by(fit.model.delay_s))
    # A delay of one period shifts the drive by its change per sample.
    rows = np.column_stack((linearised.regressors, np.gradient(drives)))
    return replace(linearised, regressors=rows)


def _delay_error(fit: Fit, covariance: FloatArray | None) -> float | None:
    """Return the half width of a delay, in s; None if it was given."""
    if fit.delay is None:
        return None
    if covariance is None or fit.delay.one_frequency:  # it looks like a wider loop
        return fit.delay.uncertainty_s
    place = DELAY if isinstance(fit.linearised, LinearisedSurface) else -1
    return SIGMAS_95 * float(np.sqrt(covariance[place, place])) * fit.record.period_s


def _creep_error(linearised: LinearProblem, covariance: FloatArray) -> float | None:
    """Return the half width of the creep per decade; None without creep."""
    gradient = linearised.creep_gradient
    if gradient is None:
        return None
    gradient = np.pad(gradient, (0, covariance.shape[0] - gradient.size))
    return SIGMAS_95 * float(np.sqrt(gradient @ covariance @ gradient))


def _mode_error(covariance: FloatArray, period_s: float) -> FirstMode:
    """Return the half widths of the frequency, the damping and the lag of a mode."""
    errors = MODE_COVERAGE * np.sqrt(np.diag(covariance)[[*MODE]])
    frequency, damping, lag = (SIGMAS_95 * errors).tolist()
    return FirstMode(frequency / period_s, damping, lag * period_s)
