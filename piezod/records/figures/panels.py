"""Panels and headlines that several figures have."""

from matplotlib.axes import Axes

from piezod.records.experiment_result import Recording
from piezod.records.figures.style import COMMAND, POSITION, legend_above
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray


def headline(recording: Recording, mode: str) -> str:
    """Return the headline of a figure of one case in one mode, or in all."""
    text = f"{recording.case} · {mode} · axis {recording.axis}"
    return f"{text}: {recording.title}" if recording.title else text


def draw_displacement(
    axes: Axes,
    t_s: FloatArray,
    position_um: FloatArray,
    command_um: FloatArray,
    title: str,
    unit: str = "µm",
) -> None:
    """Draw measured displacement and command over time; a user axis may be in µrad."""
    draw_trace(axes, t_s, position_um, label="measured", **POSITION)
    draw_trace(axes, t_s, command_um, label="command", **COMMAND)
    axes.set(title=title, ylabel=f"displacement ({unit})")
    legend_above(axes)


def draw_zero(axes: Axes) -> None:
    """Draw the line of no error."""
    axes.axhline(0.0, color="black", linewidth=0.6)


def label_loop(axes: Axes, title: str, drive: str = "uncompensated voltage") -> None:
    """Label a panel of measured displacement over a voltage."""
    axes.set(title=title, xlabel=f"{drive} (V)", ylabel="measured displacement (µm)")
