"""The figure of a model beside the record that it was fitted to, or is tested on."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezod.records.figures.style import (
    BROAD_DRIVE,
    ERROR,
    ERROR_DOTS,
    PREDICTED,
    add_percent_axis,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray
from piezod.records.labels import metric_text
from piezod.records.recording import Identification


@house_style()
def identification_figure(identification: Identification) -> Figure:
    """Draw data and model: (a) over time, (b) as a loop, (c) and (d) their difference.

    Args:
        identification: What to draw, with at least one sample.
    """
    title = f"Model by {identification.method} · axis {identification.axis}: {identification.title}"
    errors = ", ".join(metric_text(*item) for item in identification.fit_errors.items())
    figure = new_figure(13.0, 6.6, title, errors)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.35, 1.0), height_ratios=(1.5, 1.0))
    over_time = figure.add_subplot(grid[0, 0])
    loop = figure.add_subplot(grid[0, 1])
    residual = figure.add_subplot(grid[1, 0], sharex=over_time)
    residual_loop = figure.add_subplot(grid[1, 1], sharex=loop, sharey=residual)
    _draw_both(over_time, identification.t_s, identification)
    _draw_both(loop, identification.position_um, identification)
    _draw_residual(residual, identification.t_s, identification, ERROR)
    _draw_residual(residual_loop, identification.position_um, identification, ERROR_DOTS)
    over_time.set_title("(a) Drive over time")
    loop.set_title("(b) Loop")
    residual.set_title("(c) Residual: predicted minus measured")
    round_time_ticks(residual)
    residual_loop.set(title="(d) Residual in the loop", xlabel="measured displacement (µm)")
    add_percent_axis(residual_loop, identification.drive_range_v, "% of voltage range")
    for axes in (over_time, loop):
        axes.tick_params(labelbottom=False)
    return figure


def _draw_both(axes: Axes, x: FloatArray, identification: Identification) -> None:
    draw_trace(axes, x, identification.drive_v, label="measured", **BROAD_DRIVE)
    draw_trace(axes, x, identification.predicted_v, label="predicted", **PREDICTED)
    axes.set_ylabel("drive voltage (V)")
    legend_above(axes)


def _draw_residual(
    axes: Axes, x: FloatArray, identification: Identification, style: dict[str, Any]
) -> None:
    draw_trace(axes, x, identification.residual_v, **style)
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set_ylabel("residual (V)")
