"""The figures of `docs/modes.md`."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from docs.figures.errors import SHOWN_MODES, STOPS, Errors
from docs.figures.runs import HOLD_S, MOVE_S, WITHOUT_CREEP
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import Recording
from piezod.records.figures.overview import MODE_MARKS, Dot
from piezod.records.figures.style import (
    BLACK,
    COMMAND,
    ERROR_LABEL,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace

_WIDTH_IN: Final = 10.0
_PALE: Final = 0.35
_PLAIN: Final = FuncFormatter(lambda value, _: f"{value:g}")
_STOPS: Final = Dot("o", BLACK)


@house_style()
def tracking_figure(recordings: Sequence[Recording]) -> Figure:
    """Draw one case: the command, then the error of each mode over time.

    Args:
        recordings: Of one case, one for each mode, the one without compensation first.
    """
    title = "One command in four modes; the first error has a scale of its own"
    figure = new_figure(_WIDTH_IN, 8.6, title, "")
    rows = figure.subplots(len(recordings) + 1, 1, sharex=True, height_ratios=(1.6, 1, 1, 1, 1))
    first, *compensated = recordings
    for recording, width in ((first, 1.5), (compensated[-1], 3.0)):
        style = {"color": _colour(recording.mode), "linewidth": width, "label": recording.mode}
        draw_trace(rows[0], recording.t_s, recording.true_um, **style)
    draw_trace(rows[0], first.t_s, first.command_um, label="command", **COMMAND)
    rows[0].set(title="Displacement", ylabel="µm")
    legend_above(rows[0])
    largest = max(_largest_pct(recording) for recording in compensated)
    for axes, recording in zip(rows[1:], recordings, strict=True):
        _draw_error(axes, recording)
        if recording is not first:
            axes.set_ylim(-1.1 * largest, 1.1 * largest)
    round_time_ticks(rows[-1])
    return figure


def _draw_error(axes: Axes, recording: Recording) -> None:
    to_pct, colour = 100.0 / recording.position_range_um, _colour(recording.mode)
    worst = max(np.abs(recording.true_error_um[recording.first_metric_index :])) * to_pct
    for error, style in (
        (recording.error_um, {"alpha": _PALE, "linewidth": 0.7, "label": "measured"}),
        (recording.true_error_um, {"linewidth": 1.2, "label": "true"}),
    ):
        draw_trace(axes, recording.t_s, error * to_pct, color=colour, **style)
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    end_s = recording.t_s[recording.first_metric_index]
    axes.axvspan(0.0, end_s, color="#ECECEC", zorder=0, linewidth=0, label="not judged")
    axes.set(title=f"{recording.mode}: error at most {worst:.2f} %", ylabel="% of range")
    legend_above(axes)


def _largest_pct(recording: Recording) -> float:
    error_um = recording.error_um[recording.first_metric_index :]
    return float(np.nanmax(np.abs(error_um)) / recording.position_range_um * 100.0)


def _colour(mode: str) -> str:
    return MODE_MARKS[mode].colour


@house_style()
def holding_figure(holds: Mapping[str, Recording]) -> Figure:
    """Draw where a stage is after a move, over time and over its logarithm.

    Args:
        holds: Recordings of one command, a move and a hold, by what is done about creep.
    """
    title = "A move of 20 µm in 1 s, then a hold: how far the stage is from where it should be"
    figure = new_figure(_WIDTH_IN, 4.2, title, "")
    linear, logarithmic = figure.subplots(1, 2, sharey=True)
    for label, recording in holds.items():
        style = {"color": _colour(recording.mode), "linewidth": 1.6, "label": label}
        if label == WITHOUT_CREEP:
            style["linestyle"] = (0, (4, 2))
        t_s, error_um = _averaged(recording)
        for axes in (linear, logarithmic):
            axes.plot(t_s, error_um, **style)
    for axes in (linear, logarithmic):
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        axes.set_xlabel("time since the move (s)")
    linear.set(title="Over time", ylabel=ERROR_LABEL)
    logarithmic.set(title="Over its logarithm", xscale="log")
    logarithmic.xaxis.set_major_formatter(_PLAIN)
    handles, labels = linear.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def _averaged(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return times since the move, and the true error around each, free of jitter."""
    edges_s = MOVE_S + np.geomspace(0.02, HOLD_S * 0.999, 120)
    starts = np.searchsorted(recording.t_s, edges_s)
    sums = np.add.reduceat(recording.true_error_um, starts)[:-1]
    return np.sqrt((edges_s[1:] - MOVE_S) * (edges_s[:-1] - MOVE_S)), sums / np.diff(starts)


@house_style()
def variants_figure(errors: Errors) -> Figure:
    """Draw true tracking errors and nonlinearities of every mode on every stage.

    Args:
        errors: Stage → mode → metric → error in %.
    """
    figure = new_figure(_WIDTH_IN, 5.6, "True errors on all simulated stages", "")
    panels = figure.subplots(1, 2, sharey=True)
    marks = {mode: MODE_MARKS.get(mode, _STOPS) for mode in SHOWN_MODES}
    for axes, metric in zip(
        panels, ("true_tracking_max_pct", "true_nonlinearity_pct"), strict=True
    ):
        for y, modes in enumerate(errors.values()):
            for mode, mark in marks.items():
                axes.add_line(mark.line([modes[mode][metric]], [y], filled=mode != STOPS))
        _percent_scale(axes)
    panels[0].set_title("Worst tracking error, largest of three cases")
    panels[1].set_title("Nonlinearity, largest of three cases")
    panels[0].set_yticks(range(len(errors)), labels=list(errors))
    panels[0].set_ylim(len(errors) - 0.4, -0.6)
    handles = [mark.line([], [], mode, filled=mode != STOPS) for mode, mark in marks.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _percent_scale(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_xlim(0.03, 30.0)
    axes.set_xticks([0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0])
    axes.xaxis.set_major_formatter(_PLAIN)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("% of range")
    axes.tick_params(axis="y", length=0)


@house_style()
def specimen_figure(recordings: Sequence[Recording]) -> Figure:
    """Draw how large the errors are while a stage is driven by the model of another one.

    Args:
        recordings: Of one case, one for each mode.
    """
    title = "The stage is exchanged for another one of its kind; the model is that of the first"
    figure = new_figure(_WIDTH_IN, 4.0, title, "")
    axes = figure.subplots()
    for recording in recordings:
        t_s, worst_pct = _envelope(recording, 1.0)
        axes.stairs(
            worst_pct, t_s, color=_colour(recording.mode), linewidth=1.8, label=recording.mode,
            baseline=None,
        )  # fmt: skip
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(_PLAIN)
    axes.set_ylabel("worst true error\nin each second (% of range)")
    round_time_ticks(axes)
    legend_above(axes)
    return figure


def _envelope(recording: Recording, window_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the edges of windows, and the largest true error in each, in % of the range."""
    edges_s = np.arange(0.0, recording.t_s[-1] + window_s, window_s)
    starts = np.searchsorted(recording.t_s, edges_s[:-1])
    error_um = np.abs(recording.true_error_um)
    return edges_s, np.maximum.reduceat(error_um, starts) * (100.0 / recording.position_range_um)
