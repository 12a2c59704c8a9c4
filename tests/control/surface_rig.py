"""The shipped stage with a surface as its model."""

from functools import cache
from pathlib import Path

import numpy as np

from piezod.config.daemon import DaemonConfig
from piezod.config.model_file import ModelFile, dump_model, load_model
from piezod.control.law.model_files import from_model_file
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from tests.control.rig_stage import shipped_config


@cache
def surface_file() -> ModelFile:
    """Return the surface that is closest to the shipped model, with its creep and delay."""
    path = shipped_config().axes["x"].model
    assert path is not None
    stops_file = load_model(path)
    stops = from_model_file(stops_file)
    t_s = np.arange(6000) / 100.0
    swing = 0.5 + 0.5 * np.cos(0.31 * t_s)
    drives = 0.5 - 0.5 * swing * np.cos(2.0 * np.pi * 0.7 * t_s)
    drives[0], drives[1:80] = 0.0, np.linspace(0.0, 1.0, 79)
    positions = stops.form.positions_at(stops.weights, drives)
    record = Record(t_s, stops.drive_v.from_unit(drives), stops.position_um.from_unit(positions))
    settings = FitSettings(method=Method.SURFACE, delay_s=0.0, smoothing=False)
    model = fit_model(record, settings).model
    return ModelFile.model_validate(
        stops_file.model_dump()
        | {
            "version": 2,
            "method": "surface",
            "right_stop_thresholds": (),
            "right_stop_weights": (),
            "left_stop_thresholds": (),
            "left_stop_weights": (),
            "surface_coefficients": tuple(model.weights.tolist()),
            "drive_low_v": model.drive_v.low,
            "drive_high_v": model.drive_v.high,
            "position_low_um": model.position_um.low,
            "position_high_um": model.position_um.high,
        }
    )


def surface_config(folder: Path) -> DaemonConfig:
    """Return the shipped configuration with that model, in a file in a folder."""
    path = folder / "surface.yaml"
    path.write_text(dump_model(surface_file()), encoding="utf-8")
    config = shipped_config()
    axis = config.axes["x"].model_copy(update={"model": path})
    return config.model_copy(update={"axes": {"x": axis}, "rate_hz": 500.0})
