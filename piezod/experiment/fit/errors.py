"""Errors of a fit: on its record, on held-out blocks, on another record, and of what they consist.

In the cross-validation memory and creep run through the whole record; only the fit leaves a block
out.

The breakdown has the parts of the residual of the position: drift, rate, vibration, noise, and the
rest. Each part is removed before the next one is searched. The squares of the parts therefore add
up to that of the residual, about. The rest is what the model does not describe in the loops
themselves.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from piezod.control.law.model import StageModel
from piezod.experiment.fit.excitation import turning_points
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.residuals import BLOCKS, Residuals, blocks_of, rms_of, standard_error
from piezod.experiment.fit.spectrum import noise_of, vibration_of
from piezod.hysteresis.memory import FloatArray

_STEP = 0.01  # shift in units of the range, to find its effect on the voltage
AT_END, AWAY = 0.02, 0.1
"""A drive within this share of its range from an end visits the end; beyond the second, it left."""
FEWEST_VISITS = 3
LEAST_DECADES = 0.1
"""Smallest spread of the rates, as a standard deviation, that shows how loops depend on them."""


@dataclass(frozen=True)
class Block:
    """One block of a record, and the model that was fitted to the others."""

    start_s: float  #: Time of its first sample, in s.
    end_s: float  #: Time of its last sample, in s.
    model: StageModel  #: The model.
    residuals: Residuals  #: Residuals of the block.

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms errors of the block, by name."""
        return self.residuals.errors


@dataclass(frozen=True)
class CrossValidation:
    """Errors over all blocks."""

    blocks: tuple[Block, ...]  #: The blocks, in the order of time.

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms errors of the predicted voltage and position, in %, by name."""
        return Residuals.joined([block.residuals for block in self.blocks]).errors

    @property
    def rms_pct(self) -> float:
        """Rms error of the voltage, in %."""
        return self.errors["voltage_error_rms_pct"]

    @property
    def position_rms_pct(self) -> float:
        """Rms error of the position, in %."""
        return self.errors["position_error_rms_pct"]

    @property
    def worst_block_rms_pct(self) -> float:
        """Rms error of the position in the worst block, in %: of motion unlike the rest."""
        return float(np.sqrt(np.max(self.squares.position_pct)))

    @property
    def rms_with_standard_error_pct(self) -> float:
        """Rms error of the voltage plus one standard error of its mean square over the blocks."""
        squares = self.squares.voltage_pct
        return float(np.sqrt(np.mean(squares) + standard_error(squares)))

    @property
    def squares(self) -> Residuals:
        """Mean squared residuals of each block, in %², shape (blocks,) each."""
        blocks = [block.residuals for block in self.blocks]
        return Residuals(
            np.array([np.mean(block.voltage_pct**2) for block in blocks]),
            np.array([np.mean(block.position_pct**2) for block in blocks]),
        )


def cross_validate(fit: Fit, blocks: int = BLOCKS) -> CrossValidation:
    """Return the errors of a fit on blocks of its record, each held out once."""
    record = fit.record
    counted = record.counted(fit.model.delay_s)
    held_out = []
    for rows in blocks_of(counted, blocks):
        model, times_s = fit.without(rows), record.t_s[rows]
        held_out.append(
            Block(
                start_s=float(times_s[0]),
                end_s=float(times_s[-1]),
                model=model,
                residuals=fit.residuals(record, model).at(rows[counted]),
            )
        )
    return CrossValidation(tuple(held_out))


@dataclass(frozen=True)
class OffsetRemoved:
    """Errors after constants were removed from the predicted voltage and position of a record.

    From day to day a stage, or the zero of its sensor, drifts; the loops stay.
    """

    offset_pct: float  #: The constant of the voltage, in % of its range.
    offset_um: float  #: Shift of the displacement that would cause it, in µm.
    position_offset_um: float  #: The constant of the predicted position, in µm.
    errors: Mapping[str, float]  #: Remaining errors, by name.


@dataclass(frozen=True)
class Judgement:
    """A fit and its errors, by name, in % of the ranges of voltage and position in its record."""

    fit: Fit  #: The fit.
    train: Mapping[str, float]  #: Errors on its own record.
    validation: CrossValidation  #: Errors on held-out blocks of that record.
    test: Mapping[str, float] | None  #: Errors on another record, None without one.
    test_offset_removed: OffsetRemoved | None  #: The same without a constant offset.


def judge(
    fit: Fit, record: Record, test: Record | None, validation: CrossValidation | None = None
) -> Judgement:
    """Return the errors of a fit.

    Args:
        fit: The fit.
        record: Its record, before smoothing.
        test: Another record of the same stage.
        validation: Its cross-validation, if it is known already.
    """
    return Judgement(
        fit=fit,
        train=fit.errors_pct(record),
        validation=validation or cross_validate(fit),
        test=fit.errors_pct(test) if test else None,
        test_offset_removed=_without_offset(fit, test) if test else None,
    )


def _without_offset(fit: Fit, test: Record) -> OffsetRemoved:
    as_fitted = fit.as_fitted(test)
    residuals = fit.residuals(as_fitted)
    offset_pct, position_offset_pct = residuals.offsets_pct
    # The slope of the inverse model, from a small shift, converts the offset from V to µm.
    step_um = _STEP * fit.model.position_um.width
    shifted = replace(
        as_fitted, position_um=as_fitted.position_um - math.copysign(step_um, offset_pct)
    )
    changed_pct = abs(offset_pct - float(np.mean(fit.residuals_pct(shifted))))
    return OffsetRemoved(
        offset_pct=offset_pct,
        offset_um=step_um * offset_pct / changed_pct if changed_pct else 0.0,
        position_offset_um=0.01 * position_offset_pct * fit.model.position_um.width,
        errors=residuals.without_offsets().errors,
    )


@dataclass(frozen=True)
class Breakdown:
    """Parts of the residual of the position, rms in % of its range."""

    total_pct: (
        float  #: The residual without its mean, of the record before averaging and smoothing.
    )
    drift_pct: float  #: Drift of the return points.
    #: Range of the mean residuals at the visits of the lowest and of the highest voltage, the
    #: larger one; None if there are fewer than three visits.
    return_point_drift_pct: float | None
    rate_pct: float  #: Loops that widen with the rate of the drive.
    #: Growth of their width per decade of the rate, in % of the swing; None if the record has only
    #: one rate.
    widening_pct: float | None
    vibration_pct: float  #: Vibration at one frequency that the drive does not have.
    vibration_hz: float | None  #: That frequency; None if there is none.
    noise_pct: float  #: White noise.
    rest_pct: float  #: Everything else: mainly the shape of the loops.


def breakdown_of(fit: Fit, record: Record) -> Breakdown:
    """Return the parts of the residual of a fit.

    Args:
        fit: The fit.
        record: Its record, before averaging and smoothing.
    """
    counted = record.counted(fit.model.delay_s)
    drive = fit.model.drive_v.to_unit(record.drive_delayed_by(fit.model.delay_s))[counted]
    left_pct = fit.position_residuals_pct(record)
    left_pct = left_pct - np.mean(left_pct)
    total_pct = rms_of(left_pct)
    drifting_pct, return_point_drift_pct = _drift(drive, left_pct)
    left_pct = left_pct - drifting_pct
    widening_pct, by_rate_pct = _rate(drive, record.period_s, left_pct)
    left_pct = left_pct - by_rate_pct
    vibration_pct, vibration_hz = vibration_of(left_pct, drive, record.period_s)
    noise_pct = noise_of(left_pct, vibration_hz, record.period_s)
    known = rms_of(drifting_pct) ** 2 + rms_of(by_rate_pct) ** 2 + vibration_pct**2 + noise_pct**2
    return Breakdown(
        total_pct=total_pct,
        drift_pct=rms_of(drifting_pct),
        return_point_drift_pct=return_point_drift_pct,
        rate_pct=rms_of(by_rate_pct),
        widening_pct=widening_pct,
        vibration_pct=vibration_pct,
        vibration_hz=vibration_hz,
        noise_pct=noise_pct,
        rest_pct=float(np.sqrt(max(total_pct**2 - known, 0.0))),
    )


def _drift(drive: FloatArray, residuals_pct: FloatArray) -> tuple[FloatArray, float | None]:
    """Return the drift of the return points over time, shape (k,), and its range."""
    above = (drive - drive.min()) / np.ptp(drive)
    paths, ranges = [], []
    for distance in (above, 1.0 - above):
        places, means_pct = _visits(distance, residuals_pct)
        if places.size >= FEWEST_VISITS:
            paths.append(np.interp(np.arange(drive.size), places, means_pct))
            ranges.append(float(np.ptp(means_pct)))
    if not paths:
        return np.zeros(drive.size), None
    path = np.mean(paths, axis=0)
    path -= np.mean(path)
    return _share_of(path, residuals_pct), max(ranges)


def _visits(distance: FloatArray, residuals_pct: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middle sample and the mean residual of each visit of an end, shape (v,) each."""
    away = distance > AWAY
    number = np.cumsum(np.diff(away, prepend=False) & away)  # a visit ends when the drive leaves
    here = np.flatnonzero(distance <= AT_END)
    _, visit = np.unique(number[here], return_inverse=True)
    counts = np.bincount(visit)
    return np.bincount(visit, here) / counts, np.bincount(visit, residuals_pct[here]) / counts


def _rate(
    drive: FloatArray, period_s: float, residuals_pct: FloatArray
) -> tuple[float | None, FloatArray]:
    """Return the widening of the loops per decade of the rate, and its residual, shape (k,)."""
    turns = turning_points(drive)
    bulge, decades = np.zeros(drive.size), np.zeros(drive.size)
    for first, last in pairwise(turns):
        swing = drive[first : last + 1]
        size = float(swing[-1] - swing[0])
        steps = np.abs(np.diff(swing))
        if not size or not steps.any():
            continue
        along = np.clip((swing - swing[0]) / size, 0.0, 1.0)
        # A loop is widest in its middle; predicted minus recorded is positive there while rising.
        bulge[first : last + 1] = size * 4.0 * along * (1.0 - along)
        # The rate at which the distance is covered: holds do not count.
        decades[first : last + 1] = np.log10(np.sum(steps**2) / np.sum(steps) / period_s)
    weights = bulge**2
    if not weights.any():
        return None, np.zeros(drive.size)
    decades -= np.average(decades, weights=weights)
    if np.sqrt(np.average(decades**2, weights=weights)) < LEAST_DECADES:
        return None, np.zeros(drive.size)
    # The error of the width at all rates alike is no effect of the rate: `decades` has mean zero.
    shape = bulge * decades
    grown = float(residuals_pct @ shape / (shape @ shape))
    return 2.0 * grown, grown * shape


def _share_of(path: FloatArray, values: FloatArray) -> FloatArray:
    """Return the multiple of a path, from 0 to 1, that is nearest to values."""
    power = float(path @ path)
    share = min(max(float(path @ values) / power, 0.0), 1.0) if power else 0.0
    return share * path
