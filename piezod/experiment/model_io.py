"""Model files out and in: a fitted model becomes a file's contents, and these a model again."""

import hashlib
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
from pydantic import ValidationError

import piezod
from piezod.config.model_file import FitConfig, ModelFile, SourceConfig, load_model
from piezod.errors import ConfigError, ModelError, Problem
from piezod.experiment.creep_law import CreepLaw
from piezod.experiment.fit import Fit
from piezod.experiment.stage_model import StageModel
from piezod.hysteresis import AffineRange, new_bank
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.slopes import smallest_slope_of


def to_model_file(
    fit: Fit, source: Path, errors_pct: Mapping[str, float], created_at: datetime
) -> ModelFile:
    """Return the contents of a model file, with every number as it is.

    Args:
        fit: The model, and how its weights were found.
        source: The data file that it was fitted to; read again for its hash.
        errors_pct: Errors on that data, from `Fit.errors_pct`.
        created_at: When the model was made, with a time zone.

    Raises:
        ModelError: If a number is beyond what a model file may hold.
        OSError: If the data file cannot be read.
    """
    model = fit.model
    left_thresholds, right_thresholds = _sides(model.bank[0])
    left_weights, right_weights = _sides(model.weights)
    try:
        return ModelFile(
            created_at=created_at.isoformat(timespec="seconds"),
            created_by=f"piezod {piezod.__version__}",
            method=fit.settings.method.value,
            source=SourceConfig(file=source.name, sha256=_sha256(source)),
            fit=FitConfig(**errors_pct),
            drive_low_v=model.drive_v.low,
            drive_high_v=model.drive_v.high,
            position_low_um=model.position_um.low,
            position_high_um=model.position_um.high,
            delay_s=model.delay_s,
            creep_time_constants_s=tuple(model.creep.time_constants_s.tolist()),
            creep_weights=tuple(model.creep.weights.tolist()),
            right_stop_thresholds=right_thresholds,
            right_stop_weights=right_weights,
            left_stop_thresholds=left_thresholds,
            left_stop_weights=left_weights,
        )
    except ValidationError as failure:
        first = failure.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ModelError(f"no model file can hold this model: {where}: {first['msg']}") from failure


def from_model_file(file: ModelFile) -> StageModel:
    """Return the model that a file holds, equal to the last bit to the one written.

    Raises:
        ModelError: If the file has more thresholds on one side than on the other, or the model is
            not monotone, so that no stage is like it.
    """
    bank = new_bank(file.left_stop_thresholds, file.right_stop_thresholds)
    weights = np.array([*file.left_stop_weights, *file.right_stop_weights])
    slope = smallest_slope_of(bank, weights)
    if slope <= 0.0:
        message = (
            f"the model is not monotone: its smallest slope is {slope:.3g}, allowed is above 0; "
            "the drive would at times go against the command; identify again"
        )
        raise ModelError(message)
    return StageModel(
        bank=bank,
        weights=weights,
        drive_v=AffineRange.checked(file.drive_low_v, file.drive_high_v),
        position_um=AffineRange.checked(file.position_low_um, file.position_high_um),
        delay_s=file.delay_s,
        creep=CreepLaw(np.array(file.creep_time_constants_s), np.array(file.creep_weights)),
    )


def read_model(path: Path) -> tuple[StageModel, ModelFile]:
    """Return the model in a file, and everything that the file says of it.

    Raises:
        ConfigError: If it is no model file, or holds a model that cannot be used.
    """
    file = load_model(path)
    try:
        return from_model_file(file), file
    except ModelError as error:
        raise ConfigError(Problem(str(path), 0, 0, "", str(error))) from error


def _sides(both: FloatArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return what belongs to the left and to the right stops; a bank has the left ones first."""
    left, right = np.split(both, 2)
    return tuple(left.tolist()), tuple(right.tolist())


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
