"""Estimates the delay from drive to displacement: the shift at which a model fits best."""

from dataclasses import dataclass

import numpy as np

from piezod.errors import DataError
from piezod.experiment.fit.record import Record
from piezod.hysteresis import AffineRange
from piezod.hysteresis.memory import FloatArray

SEARCHED_DELAY_S = 0.02
FEWEST_PERIODS, MOST_PERIODS = 6, 60
"""Delays are searched from 0 to 20 ms, over at least 6 and at most 60 sample periods."""
STEP_PERIODS = 0.1
ONE_FREQUENCY_SHARE = 0.95
"""A record has one frequency if its strongest line, with neighbours, has this share of the
power."""


@dataclass(frozen=True)
class DelayEstimate:
    """Estimate of the delay of a record."""

    delay_s: float  #: The delay that fits best, in s.
    candidates_s: FloatArray  #: (n,) delays that were tried, in s.
    #: (n,) rms error of the voltage or of the position, predicted for each, in % of its range.
    criterion_pct: FloatArray
    #: Whether the drive has a single frequency. A delay then looks like a wider loop, and the model
    #: absorbs part of it.
    one_frequency: bool
    #: Uncertainty of the delay: the time in which the drive moves by the rms error of the best fit,
    #: since a shift could hide in that error. It is at least half a step between candidates, and at
    #: least one sample period if the drive has one frequency.
    uncertainty_s: float
    of_position: bool = False  #: Whether the criterion is the error of the position.


def estimate_delay(
    record: Record, regressors: FloatArray, positions: FloatArray, drive_v: AffineRange
) -> DelayEstimate:
    """Estimate the delay by fitting a model for every candidate.

    The regressors depend on the displacement alone, so that one factorisation serves all
    candidates.

    Args:
        record: Drive and displacement.
        regressors: (n, 2 M) stops of the displacement, minus the displacement.
        positions: (n,) displacement, normalised.
        drive_v: Range of the drive, in V.

    Raises:
        DataError: If the record is shorter than ten times the longest delay.
    """
    longest = longest_delay_periods(record.period_s)
    steps = round(longest / STEP_PERIODS)
    candidates_s = np.arange(steps + 1, dtype=np.float64) * STEP_PERIODS * record.period_s
    n_samples = np.count_nonzero(record.counted())
    if n_samples < 10 * longest + regressors.shape[1]:
        message = f"{n_samples} samples are too few to estimate a delay; give one"
        raise DataError(message)
    # All candidates are compared on the same samples.
    counted = record.counted(longest * record.period_s)
    drives = np.stack([drive_v.to_unit(record.drive_delayed_by(d)) for d in candidates_s], axis=1)
    targets = (drives - positions[:, np.newaxis])[counted]
    # The residual of a least-squares fit is what a projection on the regressors leaves of the
    # target.
    basis, _ = np.linalg.qr(regressors[counted])
    residual = np.sum(targets**2, axis=0) - np.sum((basis.T @ targets) ** 2, axis=0)
    criterion_pct = 100.0 * np.sqrt(np.maximum(residual, 0.0) / targets.shape[0])
    one_frequency = has_one_frequency(drive_v.to_unit(record.drive_v))
    speed = float(np.std(np.diff(drives[:, 0]))) / record.period_s
    hidden_s = 0.01 * float(criterion_pct.min()) / speed
    smallest_s = (1.0 if one_frequency else 0.5 * STEP_PERIODS) * record.period_s
    return DelayEstimate(
        delay_s=_minimum(candidates_s, criterion_pct),
        candidates_s=candidates_s,
        criterion_pct=criterion_pct,
        one_frequency=one_frequency,
        uncertainty_s=max(hidden_s, smallest_s),
    )


def longest_delay_periods(period_s: float) -> int:
    """Return the longest delay of the search, in sample periods."""
    return min(max(int(np.ceil(SEARCHED_DELAY_S / period_s)), FEWEST_PERIODS), MOST_PERIODS)


def has_one_frequency(drive: FloatArray) -> bool:
    """Return whether one spectral line has nearly all power of a drive, shape (n,)."""
    # The window keeps a frequency between two lines from leaking over the spectrum.
    window = np.hanning(drive.size)
    power = np.abs(np.fft.rfft((drive - drive.mean()) * window)) ** 2
    strongest = int(np.argmax(power))
    line = power[max(strongest - 3, 0) : strongest + 4]
    return bool(np.sum(line) > ONE_FREQUENCY_SHARE * np.sum(power))


def _minimum(candidates: FloatArray, criterion: FloatArray) -> float:
    """Return the minimum of the parabola through the smallest value and its neighbours."""
    best = int(np.argmin(criterion))
    if best in (0, criterion.size - 1):
        return float(candidates[best])
    before, at, after = criterion[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    offset = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(candidates[best] + offset * (candidates[1] - candidates[0]))
