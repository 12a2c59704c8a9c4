"""The figure of a record of others: what was understood, at a glance."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from piezod.records.figures.style import DRIVE, POSITION, house_style, new_figure
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray


@house_style()
def imported_figure(name: str, columns: Mapping[str, FloatArray]) -> Figure:
    """Draw drive and position over time, and the loops.

    Args:
        name: Name of the file.
        columns: `t_s`, `drive_v` and `position_um`, each of shape (n_samples,).
    """
    figure = new_figure(13.0, 5.0, f"Record of {name}", "as it was understood")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1.0))
    drive = figure.add_subplot(grid[0, 0])
    position = figure.add_subplot(grid[1, 0], sharex=drive)
    loop = figure.add_subplot(grid[:, 1])
    draw_trace(drive, columns["t_s"], columns["drive_v"], **DRIVE)
    draw_trace(position, columns["t_s"], columns["position_um"], **POSITION)
    draw_trace(loop, columns["drive_v"], columns["position_um"], **POSITION)
    drive.set(title="(a) Drive", ylabel="drive (V)")
    position.set(title="(b) Position", ylabel="position (µm)", xlabel="time (s)")
    loop.set(title="(c) Loops", xlabel="drive (V)", ylabel="position (µm)")
    return figure
