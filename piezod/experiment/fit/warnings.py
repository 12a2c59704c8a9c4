"""Warnings for the user of a model, each with a remedy."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from piezod.config.first_mode import FirstModeConfig
from piezod.config.trim import TrimConfig
from piezod.control.law.first_mode import FirstMode
from piezod.errors import DataError
from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.errors import Breakdown, Judgement
from piezod.experiment.fit.excitation import has_all_loops
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

LARGE_PCT = 5.0
"""Rms error of a prediction above which a model is of little use, in % of the voltage's range."""
RESIDUAL_PCT = 0.3
"""Rms residual below which nothing is said about its frequency, in % of the voltage's range."""
LINE_SHARE = 0.5
"""A residual with this share of its power around one frequency is a vibration, if the drive has
almost none there."""
DRIVE_SHARE = 0.01
"""Largest share of the drive's power around that frequency."""
DRIFT_PCT = 1.0
"""Drift of the return points below which there is no warning, in % of the position's range."""
DRIFT_SHARE = 0.5
"""It is a considerable part of the error from this share of the worst error on."""
FREQUENCY_SHARE, DAMPING_SHARE = 0.01, 0.1
"""Differences of a mode from the configured one that make no difference, as shares of it."""
RATE_SHARE = 0.25
"""The rate of the drive is a considerable cause from this share of the residual's power on."""


def fit_warnings(fit: Fit, period_s: float, *, by_blocks: bool = False) -> Iterator[str]:
    """Yield the warnings about a model.

    Args:
        fit: Its fit.
        period_s: Sample period, in s.
        by_blocks: Whether held-out blocks have chosen its method.
    """
    if fit.delay is not None:
        yield from _delay_warnings(fit.delay, period_s)
    record = fit.record
    if fit.model.mode is not None:  # its vibration has swings of all sizes
        record = replace(record, position_um=record.drive_v)
    if fit.settings.method is Method.SURFACE and not has_all_loops(record):
        remedy = "" if by_blocks else "Use --method auto or least-squares, or record "
        yield (
            "The record does not have loops of all sizes and heights. A surface is determined by "
            "the loops of its record only, and may be far off on others. "
            f"{remedy or 'Record '}the drive that is recommended."
        )


def mode_warnings(
    mode: FirstMode, half: FirstMode, configured: FirstModeConfig | None
) -> Iterator[str]:
    """Yield the warning about a first mode that is not that of the configuration.

    Args:
        mode: The mode that the record shows.
        half: Half widths of its frequency and damping.
        configured: The mode in the configuration of the axis; None if it has none.
    """
    found = f"The record shows the first mode at {mode_text(mode, half)}"
    if configured is None:
        yield (
            f"{found}. The configuration has none, so that the loop uses it with this model, "
            "unless the axis has a response."
        )
        return
    far_hz = max(half.frequency_hz, FREQUENCY_SHARE * configured.frequency_hz)
    far = max(half.damping, DAMPING_SHARE * configured.damping)
    if (
        abs(mode.frequency_hz - configured.frequency_hz) > far_hz
        or abs(mode.damping - configured.damping) > far
    ):
        yield (
            f"{found}; `first_mode` of the configuration, which the loop uses, has "
            f"{configured.frequency_hz:.4g} Hz and {configured.damping:.3g}. Correct it, if the "
            "record was made with the load of the stage."
        )


def trim_warnings(judged: Judgement, trim: TrimConfig) -> Iterator[str]:
    """Yield the warning about a trim that cannot remove the errors of a model."""
    worst_pct = judged.validation.errors["position_error_max_pct"]
    if trim.base == "feedforward" and worst_pct > trim.authority_pct:
        yield (
            f"The model predicts held-out positions to {worst_pct:.2g} % at worst, and the trim "
            f"removes at most {trim.authority_pct:g} %, its `authority_pct`. The stage may be of a "
            "class that the model does not describe. Use `base: adaptive` for the trim, which "
            "keeps learning."
        )


def mode_text(mode: FirstMode, half: FirstMode) -> str:
    """Return frequency and damping of a mode with their half widths, for people."""
    return (
        f"{mode.frequency_hz:.5g} ± {half.frequency_hz:.2g} Hz with a damping ratio of "
        f"{mode.damping:.3g} ± {half.damping:.2g}"
    )


def quality_warnings(judged: Judgement, record: Record, test: Record | None) -> Iterator[str]:
    """Yield the warnings about a model that describes its record badly.

    Raises:
        DataError: If a straight line predicts the voltage as well, and both are of no use.
    """
    error_pct, line_pct = judged.validation.rms_pct, _straight_line_pct(judged.fit, record)
    if error_pct >= line_pct:
        compared = (
            f"the model predicts held-out voltages to {error_pct:.3g} % rms, a straight line "
            f"through drive and displacement to {line_pct:.3g} %"
        )
        if error_pct > LARGE_PCT:
            raise DataError(
                f"{compared}: the displacement does not follow the drive as a stage does; check "
                "that position_um is the sensor of this drive, and that both columns have the same "
                "clock"
            )
        yield (
            f"{compared[0].upper()}{compared[1:]}: the record shows no hysteresis. Drive larger "
            "swings, or do without compensation."
        )
    elif error_pct > LARGE_PCT:
        yield (
            f"The model predicts held-out voltages to {error_pct:.3g} % rms only: it explains "
            "little of this record. Check sensor, noise and units, or drive more slowly."
        )
    if test is not None and judged.test_offset_removed is not None:
        test_pct = judged.test_offset_removed.errors["voltage_error_rms_pct"]
        if test_pct > LARGE_PCT:
            yield (
                f"The model predicts the test to {test_pct:.3g} % rms only, its own record to "
                f"{error_pct:.3g} %: the test seems to be of another stage or another range, or is "
                "too fast."
            )
    yield from _vibration_warnings(judged.fit, record)


def residual_warnings(judged: Judgement, parts: Breakdown) -> Iterator[str]:
    """Yield the warnings about a residual with a cause, and what record would tell more."""
    worst_pct, drift_pct = judged.train["position_error_max_pct"], parts.return_point_drift_pct
    if drift_pct is not None and drift_pct >= max(DRIFT_PCT, DRIFT_SHARE * worst_pct):
        creep = "" if judged.fit.settings.creep else ", and fit creep"
        yield (
            f"The return points drift by {drift_pct:.2g} % of the range over the record; the worst "
            f"error of the position is {worst_pct:.2g} %. The error of the voltage hides this. "
            "Record again after a longer run-in over the full range, or exclude more of the start "
            f"with --skip-s{creep}. If they drift until the end, the gain or the zero of the stage "
            "or of its sensor drifts: `adaptive` follows both."
        )
    if (
        parts.widening_pct is not None
        and parts.rate_pct >= RESIDUAL_PCT
        and parts.rate_pct**2 >= RATE_SHARE * parts.total_pct**2
    ):
        yield (
            f"The loops widen by {parts.widening_pct:.2g} % of the swing per decade of the rate, "
            "which the model does not describe. Record at the rates at which the stage is used."
        )


def _straight_line_pct(fit: Fit, record: Record) -> float:
    """Return the rms error of a straight line that predicts the voltage, in % of its range."""
    counted = record.counted(fit.model.delay_s)
    position_um = record.position_um[counted]
    drive_v = record.drive_delayed_by(fit.model.delay_s)[counted]
    line = np.polynomial.Polynomial.fit(position_um, drive_v, 1)
    error_v = line(position_um) - drive_v
    return 100.0 * float(np.sqrt(np.mean(error_v**2))) / fit.model.drive_v.width


def _vibration_warnings(fit: Fit, record: Record) -> Iterator[str]:
    # The displacement as recorded: smoothing would remove a fast vibration.
    residuals_pct = fit.residuals_pct(record)
    rms_pct = float(np.sqrt(np.mean(residuals_pct**2)))
    if rms_pct < RESIDUAL_PCT:
        return
    power = _power(residuals_pct)
    strongest = int(np.argmax(power))
    peak = slice(round(0.9 * strongest), round(1.1 * strongest) + 2)
    drive = _power(record.drive_v[record.counted(fit.model.delay_s)])
    share = float(np.sum(power[peak]) / np.sum(power))
    if share > LINE_SHARE and np.sum(drive[peak]) < DRIVE_SHARE * np.sum(drive):
        frequency_hz = strongest / (residuals_pct.size * record.period_s)
        yield (
            f"{100.0 * share:.2g} % of the residual, {rms_pct:.2g} % rms, vibrates at about "
            f"{frequency_hz:.4g} Hz, where the drive has almost no power: the stage or its mount "
            "rings, which is no hysteresis. Drive more smoothly; if it is the first mode, tell "
            "piezod with `first_mode`."
        )


def _power(values: FloatArray) -> FloatArray:
    """Return the power spectrum of values over time, without their mean, shape (n // 2 + 1,)."""
    # The window keeps slow and strong parts from leaking over the spectrum.
    return np.asarray(np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size))) ** 2)


def _delay_warnings(delay: DelayEstimate, period_s: float) -> Iterator[str]:
    if delay.one_frequency:
        yield (
            "The drive has one frequency. Such a record determines the delay only to about a "
            f"sample, {1e3 * period_s:.3g} ms: a delay looks like a wider loop, and the model "
            "absorbs part of it. Record several frequencies, or measure the delay in another way "
            "and give it."
        )
    if delay.delay_s == delay.candidates_s[-1]:
        yield (
            f"The delay is the longest that was tried, {1e3 * delay.delay_s:.3g} ms; the true one "
            "may be longer. Measure it in another way, and give it."
        )
