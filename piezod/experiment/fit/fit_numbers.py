"""Numbers of a fit, for files and figures."""

from dataclasses import asdict

import numpy as np

from piezod.config.model_file import ModelFile
from piezod.control.law.model import StageModel
from piezod.experiment.fit.errors import CrossValidation
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.record import Record
from piezod.hysteresis import ModelForm, StopForm, SurfaceForm
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import Identification


def numbers_of_fit(
    fit: Fit, record: Record, validation: CrossValidation, *, axis: str, title: str
) -> Identification:
    """Return a record and the prediction of the model from it.

    A displacement belongs to the voltage one delay before it, so the prediction is shifted by that.
    Nothing is predicted in the run-in, nor where no displacement was recorded one delay later.
    """
    predicted_v = fit.predicted_v(fit.as_fitted(record))
    later_s = record.t_s + fit.model.delay_s
    at_drive_v = np.interp(later_s, record.t_s, predicted_v, left=np.nan, right=np.nan)
    at_drive_v[~record.counted()] = np.nan
    return Identification(
        axis=axis,
        title=title,
        method=fit.settings.method.value,
        t_s=record.t_s,
        drive_v=record.drive_v,
        position_um=record.position_um,
        predicted_v=at_drive_v,
        fit_errors=_errors(fit, record, validation),
        parameters=parameters_of(fit.model),
    )


def numbers_of_file(file: ModelFile, model: StageModel, *, axis: str, title: str) -> Identification:
    """Return the errors and parameters of a model that was identified before, without a record."""
    no_samples = np.empty(0)
    return Identification(
        axis=axis,
        title=title,
        method=file.method,
        t_s=no_samples,
        drive_v=no_samples,
        position_um=no_samples,
        predicted_v=no_samples,
        fit_errors=file.fit.model_dump(exclude_none=True),
        parameters=parameters_of(model),
    )


def _errors(fit: Fit, record: Record, validation: CrossValidation) -> dict[str, float]:
    """Return the errors on the record and on held-out blocks, and the uncertainty of the delay."""
    held_out = {f"held_out_{name}": value for name, value in validation.errors.items()}
    delay = {"delay_uncertainty_ms": 1e3 * fit.delay.uncertainty_s} if fit.delay else {}
    return {**fit.errors_pct(record), **held_out, **delay}


def parameters_of(model: StageModel) -> dict[str, FloatArray]:
    """Return all parameters of a model, by name."""
    mode = model.mode._asdict() if model.mode is not None else {}
    return {
        **_hysteresis_parameters(model.form, model.weights),
        "drive_range_v": np.array(model.drive_v),
        "position_range_um": np.array(model.position_um),
        "delay_s": np.array(model.delay_s),
        "creep_time_constants_s": model.creep.time_constants_s,
        "creep_weights": model.creep.weights,
        **{f"first_mode_{name}": np.array(value) for name, value in mode.items()},
        "smallest_slope": np.array(model.form.smallest_slope(model.weights)),
    }


def _hysteresis_parameters(form: ModelForm, weights: FloatArray) -> dict[str, FloatArray]:
    match form:
        case StopForm():
            inverse = form.inverse(weights)
            return {
                "right_stop_thresholds": inverse.right_stop_thresholds,
                "right_stop_weights": inverse.right_stop_weights,
                "left_stop_thresholds": inverse.left_stop_thresholds,
                "left_stop_weights": inverse.left_stop_weights,
            }
        case SurfaceForm(path=path):
            relaxation = asdict(path) if path else {}
            return {
                "surface_coefficients": weights,
                "surface_activation": np.array(form.activation),
                "surface_prompt_slope": np.array(form.prompt_slope),
                **{f"surface_path_{name}": np.array(value) for name, value in relaxation.items()},
            }
    raise TypeError(f"no numbers of a {type(form).__name__}")
