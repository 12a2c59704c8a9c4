"""The figure of a model and the record that it was fitted to or is tested on."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.experiment_result import Identification
from piezod.records.figures.panels import draw_zero
from piezod.records.figures.style import (
    BLUE,
    BROAD_DRIVE,
    ERROR,
    ERROR_DOTS,
    PREDICTED,
    VERMILLION,
    add_percent_axis,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray
from piezod.records.labels import metric_text

_BAND_STEPS: Final = 200  # steps of displacement of the band


@house_style()
def identification_figure(
    identification: Identification, band_v: FloatArray | None = None
) -> Figure:
    """Draw data and model: (a) over time, (b) as a loop, (c) and (d) their difference.

    Args:
        identification: The identification to draw, with at least one sample.
        band_v: Half width of the uncertainty of the prediction due to noise, in V, shape
            (n_samples,); NaN if it is not known.
    """
    title = f"Model by {identification.method} · axis {identification.axis}: {identification.title}"
    errors = ", ".join(metric_text(*item) for item in _headline(identification.fit_errors))
    figure = new_figure(13.0, 6.6, title, errors)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.35, 1.0), height_ratios=(1.5, 1.0))
    over_time = figure.add_subplot(grid[0, 0])
    loop = figure.add_subplot(grid[0, 1])
    residual = figure.add_subplot(grid[1, 0], sharex=over_time)
    residual_loop = figure.add_subplot(grid[1, 1], sharex=loop, sharey=residual)
    _draw_both(over_time, identification.t_s, identification)
    _draw_both(loop, identification.position_um, identification)
    _draw_residual(residual, identification)
    if band_v is not None:
        _draw_band(residual_loop, identification.position_um, band_v)
    _draw_residual_loop(residual_loop, identification)
    over_time.set_title("(a) Drive over time")
    loop.set_title("(b) Loop")
    residual.set_title("(c) Residual: predicted minus measured")
    round_time_ticks(residual)
    residual_loop.set(title="(d) Residual loop", xlabel="measured displacement (µm)")
    add_percent_axis(residual_loop, identification.drive_range_v, "% of voltage range")
    for axes in (over_time, loop):
        axes.tick_params(labelbottom=False)
    return figure


def _headline(errors: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the errors that fit on a line: no worst ones beside those of the position."""
    short = "position_error_rms_pct" in errors
    return [item for item in errors.items() if not (short and item[0].endswith("_max_pct"))]


def _draw_both(axes: Axes, x: FloatArray, identification: Identification) -> None:
    draw_trace(axes, x, identification.drive_v, label="measured", **BROAD_DRIVE)
    draw_trace(axes, x, identification.predicted_v, label="predicted", **PREDICTED)
    axes.set_ylabel("drive voltage (V)")
    legend_above(axes)


def _draw_residual(axes: Axes, identification: Identification) -> None:
    draw_trace(axes, identification.t_s, identification.residual_v, **ERROR)
    draw_zero(axes)
    axes.set_ylabel("residual (V)")


def _draw_residual_loop(axes: Axes, identification: Identification) -> None:
    """Draw the residual over displacement, separately for rising and falling drive."""
    rises = np.gradient(identification.drive_v) >= 0.0  # a constant drive counts as rising
    for label, here, colour in (("rising", rises, BLUE), ("falling", ~rises, VERMILLION)):
        # NaN leaves out the points of the other branch.
        residual_v = np.where(here, identification.residual_v, np.nan)
        style = {**ERROR_DOTS, "color": colour}
        draw_trace(axes, identification.position_um, residual_v, label=label, **style)
    draw_zero(axes)
    axes.set_ylabel("residual (V)")
    legend_above(axes)


def _draw_band(axes: Axes, position_um: FloatArray, band_v: FloatArray) -> None:
    """Shade the uncertainty due to noise: its largest value in each small step of displacement."""
    known = np.isfinite(band_v)
    edges = np.linspace(position_um[known].min(), position_um[known].max(), _BAND_STEPS + 1)
    # The largest value lies on the last edge, hence in a step of its own: it joins the last one.
    places = np.clip(np.digitize(position_um[known], edges) - 1, 0, _BAND_STEPS - 1)
    widest = np.zeros(_BAND_STEPS)
    np.maximum.at(widest, places, band_v[known])
    axes.fill_between(
        edges[:-1], -widest, widest, step="post", color="#DDDDDD", label="noise, 95 %"
    )
