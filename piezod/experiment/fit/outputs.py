"""Output of an identification: a model file, and a figure of data and model beside it."""

from datetime import datetime
from pathlib import Path

import numpy as np

from piezod.config.model_file import dump_model
from piezod.experiment.fit.file import FileFit
from piezod.experiment.fit.fit_numbers import numbers_of_fit
from piezod.experiment.fit.model_io import to_model_file
from piezod.hysteresis.memory import FloatArray
from piezod.records.atomic import replacing
from piezod.records.figures import identification_figure, save_png
from piezod.records.figures.style import save_vector


def write_model(path: Path, fitted: FileFit, created_at: datetime, *, vector: bool = False) -> Path:
    """Write the model file and the figure; return the path of the figure.

    Args:
        path: The model file; the figure has its name with the suffix .png.
        fitted: The fit to write.
        created_at: Time at which the model was made, with a time zone.
        vector: Whether the figure is written as SVG and PDF, too.

    Raises:
        ModelError: If a number exceeds the range of a model file.
        OSError: If a file cannot be written.
    """
    chosen = fitted.chosen
    text = dump_model(
        to_model_file(chosen.fit, fitted.data, chosen.train, created_at, fitted.understood)
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    numbers = numbers_of_fit(
        chosen.fit, fitted.record, chosen.validation, axis="x", title=fitted.data.name
    )
    plot = path.with_suffix(".png")
    figure = identification_figure(numbers, _band_v(fitted))
    save_png(plot, figure)
    if vector:
        save_vector(plot, figure)
    return plot


def _band_v(fitted: FileFit) -> FloatArray | None:
    """Return the uncertainty of each prediction, in V, shape (n,); NaN in the run-in."""
    band_pct, fit = fitted.uncertainty.band_pct, fitted.chosen.fit
    if band_pct is None or fit.linearised is None:
        return None
    band_v = np.full(fitted.record.t_s.size, np.nan)
    band_v[fit.linearised.counted] = 0.01 * band_pct * fit.model.drive_v.width
    return band_v
