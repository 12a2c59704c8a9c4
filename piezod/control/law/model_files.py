"""Reads the models in model files."""

from pathlib import Path

import numpy as np

from piezod.config.model_file import ModelFile, load_model
from piezod.control.law.creep import CreepLaw
from piezod.control.law.first_mode import FirstMode
from piezod.control.law.model import StageModel
from piezod.errors import ConfigError, ModelError, Problem
from piezod.hysteresis import AffineRange, ModelForm, StopForm, SurfaceForm, new_bank
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation


def from_model_file(file: ModelFile) -> StageModel:
    """Return the model in a file, equal to the last bit to the model that was written.

    Raises:
        ModelError: If the file has more thresholds on one side than on the other, or if the model
            is not monotone, as no real stage is.
    """
    form, weights = _hysteresis(file)
    slope = form.smallest_slope(weights)
    if slope <= 0.0:
        message = (
            f"the model is not monotone: its smallest slope is {slope:.3g}, allowed is above 0; "
            "the drive would sometimes move against the command; identify again"
        )
        raise ModelError(message)
    position_um = AffineRange.checked(file.position_low_um, file.position_high_um)
    return StageModel(
        form=form,
        weights=weights,
        drive_v=AffineRange.checked(file.drive_low_v, file.drive_high_v),
        position_um=position_um,
        delay_s=file.delay_s,
        held_s=file.held_s,
        creep=CreepLaw(np.array(file.creep_time_constants_s), np.array(file.creep_weights)),
        mode=FirstMode(**file.first_mode.model_dump()) if file.first_mode else None,
        error_um=(file.fit.position_error_max_pct or 0.0) / 100.0 * position_um.width,
    )


def _hysteresis(file: ModelFile) -> tuple[ModelForm, FloatArray]:
    """Return the form of the model in a file, and its weights."""
    if not file.is_surface:
        bank = new_bank(file.left_stop_thresholds, file.right_stop_thresholds)
        return StopForm(bank), np.array([*file.left_stop_weights, *file.right_stop_weights])
    path = None
    if file.surface_path:
        path = PathRelaxation(**file.surface_path.model_dump(exclude_none=True))
    form = SurfaceForm(file.surface_activation, file.surface_prompt_slope, path=path)
    return form, np.array(file.surface_coefficients)


def read_model(path: Path) -> tuple[StageModel, ModelFile]:
    """Return the model in a file, and the contents of the file.

    Raises:
        ConfigError: If the file is no model file, or if its model cannot be used.
    """
    file = load_model(path)
    try:
        return from_model_file(file), file
    except ModelError as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error
