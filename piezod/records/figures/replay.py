"""The figure of a replay: error and drive, recorded and replayed."""

from matplotlib.figure import Figure

from piezod.records.figures.panels import draw_zero
from piezod.records.figures.style import (
    BLUE,
    DRIVE,
    ERROR,
    ERROR_LABEL,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray


@house_style()
def replay_figure(
    title: str,
    t_s: FloatArray,
    recorded_error_um: FloatArray,
    replayed_error_um: FloatArray,
    drive_difference_v: FloatArray,
) -> Figure:
    """Draw (a) both errors and (b) the difference of the drives over time.

    Args:
        title: First line of the figure.
        t_s: Time in s, shape (n,).
        recorded_error_um: Recorded error in µm, same shape; NaN where there is none.
        replayed_error_um: Error of the replay in µm, same shape.
        drive_difference_v: Voltage of the replay minus the recorded one in V, same shape.
    """
    figure = new_figure(13.0, 6.0, title, "")
    error, drive = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    draw_trace(error, t_s, recorded_error_um, label="recorded", **{**ERROR, "linewidth": 1.6})
    draw_trace(error, t_s, replayed_error_um, label="replayed", color=BLUE, linewidth=0.9)
    draw_trace(drive, t_s, drive_difference_v, **DRIVE)
    for axes in (error, drive):
        draw_zero(axes)
    error.set(title="(a) Error", ylabel=ERROR_LABEL)
    error.tick_params(labelbottom=False)
    drive.set(title="(b) Drive: replayed minus recorded", ylabel="difference (V)")
    legend_above(error)
    round_time_ticks(drive)
    return figure
