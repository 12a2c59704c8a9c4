"""The figure of a model: its loops, and what it misses of a record."""

from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.figures.panels import draw_zero
from piezod.records.figures.style import (
    BLUE,
    ERROR_DOTS,
    LOOP,
    VERMILLION,
    add_percent_axis,
    house_style,
    legend_above,
    new_figure,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray

_WIDTH_IN, _HEIGHT_IN = 7.2, 3.4
"""Width of two columns of a journal."""
_WORST: Final = "#EEEEEE"
_RMS: Final = "#D0D0D0"


class Residual(NamedTuple):
    """What a model misses of a record; arrays of shape (n,)."""

    drive_v: FloatArray  #: Voltages, in V.
    position_um: FloatArray  #: Measured positions, in µm.
    missed_um: FloatArray  #: Measured minus predicted position, in µm.


class ModelCurves(NamedTuple):
    """What is drawn of a model."""

    title: str
    loop_v: FloatArray  #: Voltages of loops inside each other, in V, shape (n,).
    loop_um: FloatArray  #: Positions of the model there, in µm, shape (n,).
    worst_um: float  #: Worst error on the record of the identification, in µm; NaN if unknown.
    rms_um: float  #: Rms error likewise.
    residual: Residual | None  #: What it misses of a record; None without one.


@house_style()
def model_figure(curves: ModelCurves) -> Figure:
    """Draw the loops of a model, and beside them its residual, or the width of the loops."""
    figure = new_figure(_WIDTH_IN, _HEIGHT_IN, curves.title, "")
    loops, missed = figure.subplots(1, 2)
    draw_trace(loops, curves.loop_v, curves.loop_um, **LOOP)
    loops.set(title="(a) Loops", xlabel="voltage (V)", ylabel="displacement (µm)")
    range_um = float(np.ptp(curves.loop_um))
    _draw_errors(missed, curves)
    if curves.residual is None:
        line = np.polynomial.Polynomial.fit(curves.loop_v, curves.loop_um, 1)
        draw_trace(missed, curves.loop_v, curves.loop_um - line(curves.loop_v), **LOOP)
        missed.set(title="(b) Deviation from a line", xlabel="voltage (V)", ylabel="deviation (µm)")
    else:
        _draw_residual(missed, curves.residual)
        missed.set(title="(b) Residual", xlabel="displacement (µm)", ylabel="residual (µm)")
    draw_zero(missed)
    add_percent_axis(missed, range_um, "% of range")
    if missed.get_legend_handles_labels()[0]:
        legend_above(missed)
    return figure


def _draw_errors(axes: Axes, curves: ModelCurves) -> None:
    """Shade the errors on the record of the identification."""
    if np.isfinite(curves.worst_um):
        axes.axhspan(-curves.worst_um, curves.worst_um, label="worst", color=_WORST)
        axes.axhspan(-curves.rms_um, curves.rms_um, label="rms", color=_RMS)


def _draw_residual(axes: Axes, residual: Residual) -> None:
    rises = np.gradient(residual.drive_v) >= 0.0
    for label, here, colour in (("rising", rises, BLUE), ("falling", ~rises, VERMILLION)):
        missed_um = np.where(here, residual.missed_um, np.nan)  # NaN leaves out the other branch
        style = {**ERROR_DOTS, "color": colour, "markersize": 1.5, "rasterized": True}
        draw_trace(axes, residual.position_um, missed_um, label=label, **style)
