"""The delay from drive to displacement, from a record: the shift at which a model fits best."""

from dataclasses import dataclass

import numpy as np

from piezod.errors import DataError
from piezod.experiment.fit.record import Record
from piezod.hysteresis import AffineRange
from piezod.hysteresis.memory import FloatArray

LONGEST_DELAY_S = 0.02
FEWEST_PERIODS, MOST_PERIODS = 6, 60
"""Delays are searched from none to 20 ms, but over at least 6 and at most 60 sample periods."""
STEP_PERIODS = 0.1
ONE_FREQUENCY_SHARE = 0.95
"""A record has one frequency if its strongest line, with neighbours, holds this share of power."""


@dataclass(frozen=True)
class DelayEstimate:
    """What the record says about the delay.

    Attributes:
        delay_s: The delay that fits best, in s.
        candidates_s: (n,) delays that were tried, in s.
        criterion_pct: (n,) rms error of the drive predicted for each, in % of its range.
        one_frequency: Whether the drive has a single frequency; a delay then looks like a wider
            loop, and the model takes up part of it.
        uncertainty_s: How far the delay may be off: as far as the drive moves by the rms error that
            the best fit leaves, since a shift could hide in it; no less than half a step between
            candidates, and than one sample period where the drive has one frequency.
    """

    delay_s: float
    candidates_s: FloatArray
    criterion_pct: FloatArray
    one_frequency: bool
    uncertainty_s: float


def estimate_delay(
    record: Record, regressors: FloatArray, positions: FloatArray, drive_v: AffineRange
) -> DelayEstimate:
    """Estimate the delay by fitting a model at every candidate.

    The regressors depend on the displacement alone, so that one factorisation serves all.

    Args:
        record: Drive and displacement.
        regressors: (n, 2 M) stops of the displacement, minus the displacement.
        positions: (n,) displacement, normalised.
        drive_v: Range of the drive, in V.

    Raises:
        DataError: If the record is shorter than ten times the longest delay.
    """
    first = longest_delay_periods(record.period_s)
    steps = round(first / STEP_PERIODS)
    candidates_s = np.arange(steps + 1, dtype=np.float64) * STEP_PERIODS * record.period_s
    n_samples = np.count_nonzero(record.counted())
    if n_samples < 10 * first + regressors.shape[1]:
        message = f"{n_samples} samples are too few to estimate a delay from; give one"
        raise DataError(message)
    counted = record.counted(first * record.period_s)
    drives = np.stack([drive_v.to_unit(record.drive_delayed_by(d)) for d in candidates_s], axis=1)
    targets = (drives - positions[:, np.newaxis])[counted]
    basis, _ = np.linalg.qr(regressors[counted])
    residual = np.sum(targets**2, axis=0) - np.sum((basis.T @ targets) ** 2, axis=0)
    criterion_pct = 100.0 * np.sqrt(np.maximum(residual, 0.0) / targets.shape[0])
    alone = has_one_frequency(drive_v.to_unit(record.drive_v))
    speed = float(np.std(np.diff(drives[:, 0]))) / record.period_s
    hidden_s = 0.01 * float(criterion_pct.min()) / speed
    least_s = (1.0 if alone else 0.5 * STEP_PERIODS) * record.period_s
    return DelayEstimate(
        delay_s=_lowest(candidates_s, criterion_pct),
        candidates_s=candidates_s,
        criterion_pct=criterion_pct,
        one_frequency=alone,
        uncertainty_s=max(hidden_s, least_s),
    )


def longest_delay_periods(period_s: float) -> int:
    """Return how many sample periods the search goes back."""
    return min(max(int(np.ceil(LONGEST_DELAY_S / period_s)), FEWEST_PERIODS), MOST_PERIODS)


def has_one_frequency(drive: FloatArray) -> bool:
    """Return whether one line holds nearly all power of a drive over time, shape (n,)."""
    window = np.hanning(drive.size)
    power = np.abs(np.fft.rfft((drive - drive.mean()) * window)) ** 2
    strongest = int(np.argmax(power))
    line = power[max(strongest - 3, 0) : strongest + 4]
    return bool(np.sum(line) > ONE_FREQUENCY_SHARE * np.sum(power))


def _lowest(candidates: FloatArray, criterion: FloatArray) -> float:
    """Return where the parabola through the least value and its neighbours is lowest."""
    best = int(np.argmin(criterion))
    if best in (0, criterion.size - 1):
        return float(candidates[best])
    before, at, after = criterion[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    offset = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(candidates[best] + offset * (candidates[1] - candidates[0]))
