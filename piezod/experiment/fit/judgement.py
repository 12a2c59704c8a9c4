"""Errors of a fit: on its own record, on held-out blocks, and on another record."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from piezod.experiment.fit.cross_validation import CrossValidation, cross_validate
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.record import Record

_STEP = 0.01  # shift in units of the range, to find its effect on the voltage


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
