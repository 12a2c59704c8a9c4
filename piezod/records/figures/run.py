"""The figure of one case in one mode: the panels of the paper, the error and the parameters."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from piezod.records.experiment_result import Recording
from piezod.records.figures.panels import draw_displacement, draw_zero, headline, label_loop
from piezod.records.figures.style import (
    BLUE,
    COMMAND,
    DRIVE,
    ERROR,
    ERROR_LABEL,
    EXCLUDED,
    LOOP,
    TRUE_ERROR,
    VERMILLION,
    add_percent_axis,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray
from piezod.records.labels import metric_group, metric_text

_RIGHT_SHADES: Final = LinearSegmentedColormap.from_list("right", ["#B3D6EA", BLUE, "#00273D"])
_LEFT_SHADES: Final = LinearSegmentedColormap.from_list("left", ["#F7CDB0", VERMILLION, "#451E00"])

_LABELLED: Final = 8
"""Number of weights that are labelled at most."""
_LABEL_SHARE: Final = 0.06
"""Height of a label, as a share of the range of the weights."""


@house_style()
def mode_figure(recording: Recording) -> Figure:
    """Draw one case in one mode.

    Panels: (a) uncompensated and applied voltage, (b) commanded and measured displacement, (c)
    measured displacement over uncompensated voltage, (d) error, also the true error if it is known,
    (e) parameters, if there are any.
    """
    figure = new_figure(13.0, 8.0, headline(recording, recording.mode), _metrics_text(recording))
    columns = figure.add_gridspec(1, 2, width_ratios=(1.35, 1.0))
    left = columns[0].subgridspec(3, 1)
    voltage = figure.add_subplot(left[0])
    position = figure.add_subplot(left[1], sharex=voltage)
    error = figure.add_subplot(left[2], sharex=voltage)
    _draw_voltage(voltage, recording)
    _draw_position(position, recording)
    _draw_error(error, recording)
    for axes in (voltage, position):
        axes.tick_params(labelbottom=False)
    if not recording.weights.size:
        _draw_loop(figure.add_subplot(columns[1].subgridspec(1, 1)[0]), recording)
        return figure
    right = columns[1].subgridspec(2, 1, height_ratios=(2, 1))
    _draw_loop(figure.add_subplot(right[0]), recording)
    _draw_weights(figure.add_subplot(right[1]), recording)
    return figure


@house_style()
def remaining_figure(recording: Recording) -> Figure:
    """Draw what a published figure of the run lacks: panels (d) and (e) of `mode_figure`."""
    figure = new_figure(13.0, 4.2, headline(recording, recording.mode), _metrics_text(recording))
    both = recording.weights.size > 0
    panels = figure.subplots(1, 1 + both, squeeze=False)[0]
    _draw_error(panels[0], recording)
    if both:
        _draw_weights(panels[1], recording)
    return figure


def _metrics_text(recording: Recording) -> str:
    """Return the errors as text: the measured ones, and the others in a second line."""
    metrics = dict(recording.metrics)
    if recording.knows_truth and metrics:
        metrics.setdefault("true_tracking_max_pct", _true_error_pct(recording))
    lines: dict[bool, list[str]] = {}
    for name, value in metrics.items():
        lines.setdefault(metric_group(name) == "measured", []).append(metric_text(name, value))
    return "\n".join(map(", ".join, lines.values()))


def _true_error_pct(recording: Recording) -> float:
    """Return the worst true error of the samples of the metrics, in % of the true range."""
    judged = slice(recording.first_metric_index, None)
    true_um = recording.true_um[judged]
    known = np.isfinite(true_um) & np.isfinite(recording.position_um[judged])
    range_um = float(np.ptp(true_um[known])) if known.any() else 0.0
    if not range_um or not np.ptp(recording.command_um[judged]):
        return float("nan")
    return 100.0 * float(np.max(np.abs(recording.true_error_um[judged][known]))) / range_um


def _draw_voltage(axes: Axes, recording: Recording) -> None:
    draw_trace(axes, recording.t_s, recording.drive_v, label="applied to the stage", **DRIVE)
    draw_trace(axes, recording.t_s, recording.uncompensated_v, label="uncompensated", **COMMAND)
    _shade_excluded(axes, recording)
    axes.set(title="(a) Voltage", ylabel="voltage (V)")
    legend_above(axes)


def _draw_position(axes: Axes, recording: Recording) -> None:
    t_s, position_um, command_um = recording.t_s, recording.position_um, recording.command_um
    draw_displacement(axes, t_s, position_um, command_um, "(b) Displacement")
    _shade_excluded(axes, recording)


def _draw_loop(axes: Axes, recording: Recording) -> None:
    first = recording.first_metric_index
    drive_v, position_um = recording.uncompensated_v, recording.position_um
    if first:
        start = slice(first + 1)
        draw_trace(axes, drive_v[start], position_um[start], label="excluded", **EXCLUDED)
    draw_trace(axes, drive_v[first:], position_um[first:], label="measured", **LOOP)
    # Command and uncompensated voltage are proportional. Two points suffice, and a dashed line
    # through every sample would look solid.
    ends = [drive_v.argmin(), drive_v.argmax()]
    axes.plot(drive_v[ends], recording.command_um[ends], label="command", **COMMAND)
    label_loop(axes, "(c) Loop")
    legend_above(axes)


def _draw_error(axes: Axes, recording: Recording) -> None:
    error = draw_trace(axes, recording.t_s, recording.error_um, **ERROR)
    if recording.knows_truth:
        error.set_label("measured")
        draw_trace(axes, recording.t_s, recording.true_error_um, label="true", **TRUE_ERROR)
    draw_zero(axes)
    axes.set(title="(d) Error", ylabel=ERROR_LABEL)
    round_time_ticks(axes)
    if np.ptp(recording.command_um[recording.first_metric_index :]) > 0.0:
        # With a constant command the range is that of the noise: percent would mean nothing.
        add_percent_axis(axes, recording.position_range_um, "% of range")
    if recording.first_metric_index:
        _shade_excluded(axes, recording).set_label("excluded from the metrics")
    if recording.knows_truth or recording.first_metric_index:
        legend_above(axes)


def _shade_excluded(axes: Axes, recording: Recording) -> Rectangle:
    end_s = recording.t_s[recording.first_metric_index]
    return axes.axvspan(recording.t_s[0], end_s, color="#ECECEC", zorder=0, linewidth=0)


def _draw_weights(axes: Axes, recording: Recording) -> None:
    # A parameter holds until the next snapshot, the last one until the end of the record.
    t_s = np.append(recording.weights_t_s, max(recording.t_s[-1], recording.weights_t_s[-1]))
    weights = np.vstack((recording.weights, recording.weights[-1:]))
    if recording.surface:
        handles = {f"c0 to c{weights.shape[1] - 1}": _draw_side(axes, t_s, weights, _RIGHT_SHADES)}
        _label_largest(axes, {"c": weights[-1]}, t_s[-1], first=0)
        axes.set(title="(e) Parameters", ylabel="coefficient")
    else:
        right, left = np.hsplit(weights, 2)
        handles = {
            f"right 1 to {right.shape[1]}": _draw_side(axes, t_s, right, _RIGHT_SHADES),
            f"left 1 to {left.shape[1]}": _draw_side(axes, t_s, left, _LEFT_SHADES),
        }
        _label_largest(axes, {"R": right[-1], "L": left[-1]}, t_s[-1])
        axes.set(title="(e) Parameters", ylabel="weight")
    round_time_ticks(axes)
    legend_above(axes, handles)


def _label_largest(
    axes: Axes, sides: Mapping[str, FloatArray], end_s: float, first: int = 1
) -> None:
    """Write the numbers of the largest weights beside them, as far as there is room.

    Args:
        axes: Axes with the lines of the weights.
        sides: Weights of each side, by its letter.
        end_s: End of the lines, in s.
        first: Number of the first weight of a side.
    """
    weights = [
        (float(weight), f"{side}{number}")
        for side, values in sides.items()
        for number, weight in enumerate(values, first)
    ]
    room = _LABEL_SHARE * float(np.ptp([weight for weight, _ in weights]))
    written: list[float] = []
    for weight, text in sorted(weights, key=lambda each: -abs(each[0]))[:_LABELLED]:
        if all(abs(weight - other) > room for other in written):
            written.append(weight)
            axes.annotate(
                text, (end_s, weight), (3, 0), textcoords="offset points", va="center", fontsize=8
            )


def _draw_side(
    axes: Axes, t_s: FloatArray, weights: FloatArray, shades: LinearSegmentedColormap
) -> tuple[Line2D, ...]:
    """Draw the weights of one side; return four of the lines, from the first to the last."""
    colours = shades(np.linspace(0, 1, weights.shape[1]))
    lines = [
        draw_trace(axes, t_s, column, color=colour, drawstyle="steps-post", linewidth=1.0)
        for column, colour in zip(weights.T, colours, strict=True)
    ]
    # Four shades side by side show the direction of the colours in the legend.
    return tuple(lines[index] for index in np.linspace(0, len(lines) - 1, 4).astype(int))
