"""The account of a fit that records and figures show."""

import numpy as np

from piezod.control.law.model import StageModel
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording import Identification


def account_of(fit: Fit, record: Record, *, axis: str, title: str) -> Identification:
    """Return the record as it is, beside what the model predicts from it.

    A displacement answers to the voltage a delay before it, so that what is predicted from it is
    moved there. Nothing is predicted in the run-in, nor at the end, where no later displacement was
    recorded.

    Args:
        fit: The model.
        record: What it was fitted to.
        axis: Name of the axis.
        title: What the record is, for people.
    """
    predicted_v = fit.predicted_v(fit.seen(record))
    later_s = record.t_s + fit.model.delay_s
    at_drive_v = np.interp(later_s, record.t_s, predicted_v, right=np.nan)
    at_drive_v[~record.counted()] = np.nan
    return Identification(
        axis=axis,
        title=title,
        method=fit.settings.method.value,
        t_s=record.t_s,
        drive_v=record.drive_v,
        position_um=record.position_um,
        predicted_v=at_drive_v,
        fit_errors=fit.errors_pct(record),
        parameters=parameters_of(fit.model),
    )


def parameters_of(model: StageModel) -> dict[str, FloatArray]:
    """Return everything that makes a model, by name."""
    inverse = model.inverse()
    return {
        "right_stop_thresholds": inverse.right_stop_thresholds,
        "right_stop_weights": inverse.right_stop_weights,
        "left_stop_thresholds": inverse.left_stop_thresholds,
        "left_stop_weights": inverse.left_stop_weights,
        "drive_range_v": np.array(model.drive_v),
        "position_range_um": np.array(model.position_um),
        "delay_s": np.array(model.delay_s),
        "creep_time_constants_s": model.creep.time_constants_s,
        "creep_weights": model.creep.weights,
        "smallest_slope": np.array(inverse.smallest_slope),
    }
