"""What `piezod plot` draws of a model."""

from pathlib import Path

import numpy as np

from piezod.inverse.loaded_model import LoadedModel, load_model
from piezod.reading.record import read_record
from piezod.records.figures.model import ModelCurves, Residual

_SWINGS = (1.0, 0.75, 0.5, 0.25)
"""Sizes of the loops, as shares of the range."""
_SAMPLES = 500
"""Samples of half a loop."""
_LOOP_HZ = 0.5


def model_curves(file: Path, record: Path | None) -> ModelCurves:
    """Return loops of a model, one inside the other, and its residual on a record.

    Raises:
        ConfigError: If the model cannot be used.
        DataError: If the record cannot be used.
    """
    model = load_model(file)
    low_v, high_v = model.drive_range_v
    turns = [0.0]
    for swing in _SWINGS:
        turns += [0.5 + 0.5 * swing, 0.5 - 0.5 * swing]
    place = np.arange((len(turns) - 1) * _SAMPLES + 1) / _SAMPLES
    loop_v = low_v + np.interp(place, np.arange(len(turns)), turns) * (high_v - low_v)
    loop_um = model.positions(place / (2.0 * _LOOP_HZ), loop_v)
    known, place_of = model.uncertainty, model.file
    return ModelCurves(
        f"{file.name}: {place_of.operators}, fitted to {place_of.source.file}",
        loop_v,
        loop_um,
        known.position_max_um,
        known.position_rms_um,
        None if record is None else _residual(model, record),
    )


def _residual(model: LoadedModel, record: Path) -> Residual:
    columns = read_record(record, command="plot").columns
    predicted_um = model.positions(columns["t_s"], columns["drive_v"])
    missed_um = columns["position_um"] - predicted_um
    # The zero of the sensor is not that of the model.
    missed_um = missed_um - float(np.mean(missed_um))
    return Residual(columns["drive_v"], columns["position_um"], missed_um)
