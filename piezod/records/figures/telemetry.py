"""The figure of one axis of a recording of a running stage."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from piezod.records.figures.overview import MODE_MARKS
from piezod.records.figures.panels import draw_displacement, draw_zero, label_loop
from piezod.records.figures.style import (
    COMMAND,
    DRIVE,
    ERROR,
    ERROR_LABEL,
    POSITION,
    PURPLE,
    VERMILLION,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.recording.marks import (
    Irregularity,
    Span,
    fault_spans,
    irregularities,
    modes_in_run,
    states,
)
from piezod.records.recording.reader import RecordedTelemetry
from piezod.records.recording.user_axes import contour_error, plane_of, user_units

COLUMNS: Final = frozenset(
    {
        *("t_s", "seq", "state", "skipped", "late_ns", "present_lo", "present_hi"),
        *("mode", "position_um", "command_um", "in_force_v", "uncompensated_v"),
    }
)
"""The columns that the figure shows."""
_LABELLED_SHARE: Final = 0.012
"""Room for a letter of a state's name, as a share of the duration."""
_STATE_COLOURS: Final = {"HOLD": "#F0B97A", "FAULT": "#E58A6B", "ESTOP": "#E58A6B"}
_OTHER_STATE: Final = "#D9D9D9"
_IDLE: Final = "#C4C4C4"
_NOT_RUNNING: Final = "not in RUN"
_ROW_IN: Final = 0.24
"""Height of a row of marks, in inches."""


@house_style()
def telemetry_figure(telemetry: RecordedTelemetry, axis: str) -> Figure:
    """Draw one axis of a recording.

    At the left over time: the states and modes, displacement and command, the error, the drive
    voltage, and what is missing or late. At the right displacement over drive voltage, in the
    colours of the modes. A user axis has its contour error and its path in place of voltages.

    Args:
        telemetry: The recording, with at least one record.
        axis: Name of the axis.
    """
    spans, faults = states(telemetry, axis), fault_spans(telemetry)
    missing = irregularities(telemetry, axis)
    rows = len(missing) + len(faults)
    subtitle = _subtitle(telemetry)
    figure = new_figure(13.5, 7.2 + _ROW_IN * rows, f"{telemetry.header.title} · {axis}", subtitle)
    heights = [0.22, 2.0, 1.0, 1.3, *([0.05 + 0.17 * rows] if rows else [])]
    columns = figure.add_gridspec(1, 2, width_ratios=(1.9, 1.0))
    left = columns[0].subgridspec(len(heights), 1, height_ratios=heights)
    position = figure.add_subplot(left[1])
    strip, error, drive = (figure.add_subplot(left[i], sharex=position) for i in (0, 2, 3))
    _draw_states(strip, spans)
    _draw_position(position, telemetry, axis)
    _draw_error(error, telemetry, axis)
    moved = axis in user_units(telemetry.header)  # a user axis has no voltage
    (_draw_contour if moved else _draw_drive)(drive, telemetry, axis)
    last = drive
    if rows:
        last = figure.add_subplot(left[4], sharex=position)
        _draw_irregularities(last, missing, faults)
    for axes in (strip, position, error, drive):
        axes.tick_params(labelbottom=axes is last)
    for axes in (position, error, drive):
        for span in spans[1:]:
            axes.axvline(span.begin_s, color="#9A9A9A", linewidth=0.6, zorder=0)
    round_time_ticks(last)
    loop = columns[1].subgridspec(2, 1, height_ratios=(2.0, 1.0))
    (_draw_path if moved else _draw_loop)(figure.add_subplot(loop[0]), telemetry, axis)
    _write_errors(figure.add_subplot(loop[1]), telemetry, axis)
    return figure


def _subtitle(telemetry: RecordedTelemetry) -> str:
    header, t_s = telemetry.header, telemetry.cycles["t_s"]
    return (
        f"{header.started_at} · {t_s.size} cycles at {header.rate_hz:g} Hz · "
        f"{t_s[0]:.4g} to {t_s[-1]:.4g} s"
    )


def _draw_states(axes: Axes, spans: tuple[Span, ...]) -> None:
    total_s = spans[-1].end_s - spans[0].begin_s
    for span in spans:
        mark = MODE_MARKS.get(span.name)
        colour = mark.colour if mark else _STATE_COLOURS.get(span.name, _OTHER_STATE)
        alpha = 0.35 if mark else 1.0
        axes.axvspan(span.begin_s, span.end_s, color=colour, alpha=alpha, linewidth=0)
        axes.axvline(span.begin_s, color="white", linewidth=1.0)
        if span.end_s - span.begin_s > _LABELLED_SHARE * len(span.name) * total_s:
            middle_s = 0.5 * (span.begin_s + span.end_s)
            axes.text(middle_s, 0.5, span.name, ha="center", va="center", fontsize=8.5)
    axes.set(ylim=(0, 1), yticks=[])
    axes.set_title("State, in RUN the mode")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def _draw_position(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    t_s, columns = telemetry.cycles["t_s"], telemetry.axes[axis]
    position_um, command_um = columns["position_um"], columns["command_um"]
    unit = user_units(telemetry.header).get(axis, "µm")
    draw_displacement(axes, t_s, position_um, command_um, "(a) Displacement", unit)


def _draw_error(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    columns = telemetry.axes[axis]
    error_um = columns["command_um"] - columns["position_um"]
    draw_trace(axes, telemetry.cycles["t_s"], error_um, **ERROR)
    draw_zero(axes)
    unit = user_units(telemetry.header).get(axis, "µm")
    axes.set(title="(b) Error", ylabel=ERROR_LABEL.replace("µm", unit))


def _draw_contour(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    """Draw how far the stage is from the path of its user axes."""
    names = plane_of(telemetry.header, axis)
    unit = user_units(telemetry.header)[axis]
    if names:
        draw_trace(axes, telemetry.cycles["t_s"], contour_error(telemetry, names), **ERROR)
    axes.set(title="(c) Contour error", ylabel=f"distance ({unit})")


def _draw_path(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    """Draw the path of the first two user axes of a plane."""
    names = plane_of(telemetry.header, axis)[:2]
    if len(names) == 2:
        across, up = (telemetry.axes[name] for name in names)
        draw_trace(axes, across["position_um"], up["position_um"], label="measured", **POSITION)
        draw_trace(axes, across["command_um"], up["command_um"], label="command", **COMMAND)
        unit = user_units(telemetry.header)[axis]
        axes.set(xlabel=f"{names[0]} ({unit})", ylabel=f"{names[1]} ({unit})")
        axes.set_aspect("equal", adjustable="datalim")
        legend_above(axes)
    axes.set_title("(e) Path")


def _draw_drive(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    t_s, columns = telemetry.cycles["t_s"], telemetry.axes[axis]
    draw_trace(axes, t_s, columns["in_force_v"], label="in force", **DRIVE)
    draw_trace(axes, t_s, columns["uncompensated_v"], label="uncompensated", **COMMAND)
    axes.set(title="(c) Drive voltage", ylabel="voltage (V)")
    legend_above(axes)


def _draw_irregularities(
    axes: Axes, missing: tuple[Irregularity, ...], faults: Mapping[str, tuple[Span, ...]]
) -> None:
    """Draw a row of ticks for each kind of missing data, and a row of bars for each fault."""
    for row, each in enumerate(missing):
        axes.plot(each.t_s, np.full(each.t_s.size, row), "|", color=VERMILLION, markersize=7)
    for row, spans in enumerate(faults.values(), len(missing)):
        for span in spans:
            axes.plot([span.begin_s, span.end_s], [row, row], color=PURPLE, linewidth=4)
    labels = [f"{each.cases} {each.name}" for each in missing]
    labels += [f"fault {name}" for name in faults]
    axes.set_yticks(range(len(labels)), labels=labels, fontsize=8.5)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_title("(d) Missing and late data, faults")
    axes.grid(visible=False, axis="y")


def _modes(telemetry: RecordedTelemetry, axis: str) -> dict[str, NDArray[np.bool_]]:
    """Return in which cycles each mode was in RUN, and in which none was, in order of time."""
    numbers, names = modes_in_run(telemetry, axis), telemetry.header.names["mode"]
    found, first = np.unique(numbers, return_index=True)
    return {
        _NOT_RUNNING if number < 0 else names[number]: numbers == number
        for number in found[np.argsort(first)].tolist()
    }


def _draw_loop(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    columns = telemetry.axes[axis]
    entries: dict[str, Line2D] = {}
    for name, rows in _modes(telemetry, axis).items():
        mark = MODE_MARKS.get(name)
        # NaN leaves out the other modes.
        position_um = np.where(rows, columns["position_um"], np.nan)
        style = {"color": mark.colour if mark else _IDLE, "linewidth": 1.0}
        entries[name] = draw_trace(axes, columns["in_force_v"], position_um, **style)
    label_loop(axes, "(e) Loop", "drive voltage in force")
    axes.legend(list(entries.values()), list(entries), loc="upper left")


def _write_errors(axes: Axes, telemetry: RecordedTelemetry, axis: str) -> None:
    """Write the errors of each mode as a small table."""
    columns = telemetry.axes[axis]
    error_um = np.abs(columns["command_um"] - columns["position_um"])
    axes.set_axis_off()
    axes.set_title("(f) Error in RUN")
    unit = user_units(telemetry.header).get(axis, "µm")
    rows = [("mode", "time (s)", f"rms ({unit})", f"worst ({unit})")]
    for name, rows_of in _modes(telemetry, axis).items():
        judged = error_um[rows_of & np.isfinite(error_um)]
        if name != _NOT_RUNNING and judged.size:
            rms_um, worst_um = np.sqrt(np.mean(judged**2)), np.max(judged)
            duration_s = judged.size / telemetry.header.rate_hz
            rows.append((name, f"{duration_s:.1f}", f"{rms_um:.3f}", f"{worst_um:.3f}"))
    for i, row in enumerate(rows):
        for x, text in zip((0.0, 0.55, 0.77, 1.0), row, strict=True):
            alignment = "right" if x else "left"
            axes.text(x, 0.92 - 0.13 * i, text, ha=alignment, transform=axes.transAxes)
