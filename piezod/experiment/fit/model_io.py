"""Turns a fitted model into the contents of a model file."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

import piezod
from piezod.config.model_file import FitConfig, ModelFile, PathConfig, SourceConfig
from piezod.control.law.model import StageModel
from piezod.errors import ModelError
from piezod.experiment.fit.fit import Fit
from piezod.hysteresis import StopForm, SurfaceForm
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.path_relaxation import PathRelaxation
from piezod.reading.part import split_path


def to_model_file(
    fit: Fit,
    source: Path,
    errors_pct: Mapping[str, float],
    created_at: datetime,
    understood: Sequence[str] = (),
) -> ModelFile:
    """Return the contents of a model file, with exact numbers.

    Args:
        fit: The model, and its fit.
        source: The data file of the fit; it is read again for its hash.
        errors_pct: Errors on that data, from `Fit.errors_pct`.
        created_at: Time at which the model was made, with a time zone.
        understood: What was inferred about the data file, a sentence each.

    Raises:
        ModelError: If a number exceeds the range of a model file.
        OSError: If the data file cannot be read.
    """
    file, part = split_path(source)
    try:
        return ModelFile(
            created_at=created_at.isoformat(timespec="seconds"),
            created_by=f"piezod {piezod.__version__}",
            method=fit.settings.method.value,
            source=SourceConfig(
                file=f"{file.name}:{part}" if part else file.name,
                sha256=_sha256(file),
                read_as=" ".join(understood) or None,
            ),
            fit=FitConfig(**errors_pct),
            **model_fields(fit.model),
        )
    except ValidationError as failure:
        first = failure.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ModelError(
            f"a model file cannot hold this model: {where}: {first['msg']}"
        ) from failure


def model_fields(model: StageModel) -> dict[str, Any]:
    """Return the fields of a model file that describe a model, with exact numbers, by name."""
    fields: dict[str, Any] = {
        "version": 3,
        "drive_low_v": model.drive_v.low,
        "drive_high_v": model.drive_v.high,
        "position_low_um": model.position_um.low,
        "position_high_um": model.position_um.high,
        "delay_s": model.delay_s,
        "held_s": model.held_s,
        "creep_time_constants_s": tuple(model.creep.time_constants_s.tolist()),
        "creep_weights": tuple(model.creep.weights.tolist()),
    }
    if model.mode is not None:
        fields["first_mode"] = model.mode._asdict()
    match model.form:
        case StopForm(bank):
            return fields | _stop_fields(bank, model.weights)
        case SurfaceForm(path=path):
            return fields | {
                "surface_coefficients": tuple(model.weights.tolist()),
                "surface_activation": model.form.activation,
                "surface_prompt_slope": model.form.prompt_slope,
                "surface_path": _path_fields(path) if path else None,
            }
        case _:
            raise TypeError(f"no model file for a {type(model.form).__name__}")


def _path_fields(path: PathRelaxation) -> PathConfig:
    exponent = None if path.exponent == 1.0 else path.exponent
    return PathConfig(**asdict(path) | {"exponent": exponent})


def _stop_fields(bank: FloatArray, weights: FloatArray) -> dict[str, Any]:
    """Return the fields of stops.

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        weights: (2 M,) weights [a^l, a^r].
    """
    left_thresholds, right_thresholds = _sides(bank[0])
    left_weights, right_weights = _sides(weights)
    return {
        "right_stop_thresholds": right_thresholds,
        "right_stop_weights": right_weights,
        "left_stop_thresholds": left_thresholds,
        "left_stop_weights": left_weights,
    }


def _sides(both: FloatArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the values of the left and of the right stops; a bank has the left ones first."""
    left, right = np.split(both, 2)
    return tuple(left.tolist()), tuple(right.tolist())


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
