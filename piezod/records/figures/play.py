"""The figure of a waveform that was learned pass by pass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from piezod.records.figures.panels import draw_zero
from piezod.records.figures.style import (
    BLUE,
    COMMAND,
    ERROR_LABEL,
    GREY,
    POSITION,
    VERMILLION,
    add_percent_axis,
    house_style,
    legend_above,
    new_figure,
    round_time_ticks,
)
from piezod.records.figures.traces import draw_trace
from piezod.records.frozen import FloatArray

_PERIODS = 2
"""Periods that are drawn."""


@dataclass(frozen=True, eq=False)
class PlayedErrors:
    """Errors of one play."""

    label: str  #: Name of the play.
    #: (n,) command minus displacement over one period, in µm; the true one if known.
    error_um: FloatArray
    measured_pct: tuple[float, float]  #: Largest and rms measured error, in % of the swing.
    true_pct: tuple[float, float]  #: The same of the true displacement; NaN if it is not known.


@house_style()
def play_figure(
    title: str,
    interval_s: float,
    command_um: FloatArray,
    plays: Sequence[PlayedErrors],
    compared: Sequence[int],
    published_pct: Mapping[str, float],
) -> Figure:
    """Draw (a) the command and the best play, (b) errors before and after, (c) errors per pass.

    Args:
        title: Headline.
        interval_s: Time between two points, in s.
        command_um: (n,) one period of the command, in µm.
        plays: Errors of each play, in order, at least one.
        compared: Places of the plays whose errors are drawn over time; the last one is the best.
        published_pct: Published errors by their label, in % of the swing.
    """
    figure = new_figure(13.0, 6.6, title, "")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.35, 1.0))
    motion, error = (figure.add_subplot(grid[i, 0]) for i in range(2))
    error.sharex(motion)
    t_s = np.asarray(np.arange(_PERIODS * command_um.size) * interval_s, dtype=np.float64)
    best = plays[compared[-1]]
    kind = "true" if np.isfinite(best.true_pct[0]) else "measured"
    played_um = np.tile(command_um - best.error_um, _PERIODS)
    draw_trace(motion, t_s, played_um, label=f"{kind}, {best.label}", **POSITION)
    draw_trace(motion, t_s, np.tile(command_um, _PERIODS), label="command", **COMMAND)
    motion.set(title="(a) Displacement", ylabel="displacement (µm)")
    motion.tick_params(labelbottom=False)
    legend_above(motion)
    for place, colour in zip(compared, (VERMILLION, BLUE), strict=False):
        values_um = np.tile(plays[place].error_um, _PERIODS)
        draw_trace(error, t_s, values_um, label=plays[place].label, color=colour, linewidth=1.0)
    draw_zero(error)
    error.set(title=f"(b) Error, {kind}", ylabel=ERROR_LABEL)
    legend_above(error)
    round_time_ticks(error)
    add_percent_axis(error, float(np.ptp(command_um)), "% of swing")
    _draw_passes(figure.add_subplot(grid[:, 1]), plays, published_pct)
    return figure


def _draw_passes(
    axes: Axes, plays: Sequence[PlayedErrors], published_pct: Mapping[str, float]
) -> None:
    places = np.arange(len(plays))
    for kind, values, colour in (
        ("true", [play.true_pct for play in plays], VERMILLION),
        ("measured", [play.measured_pct for play in plays], BLUE),
    ):
        for name, column, marker in (("worst", 0, "o"), ("rms", 1, "s")):
            each_pct = np.array(values)[:, column]
            if np.isfinite(each_pct).any():
                label, line = f"{kind}, {name}", "-" if column == 0 else ":"
                axes.plot(places, each_pct, marker, color=colour, linestyle=line, label=label)
    for label, pct in published_pct.items():
        axes.axhline(pct, color=GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        axes.annotate(label, (places[-1], pct), color=GREY, ha="right", va="bottom", fontsize=8.5)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    names = [play.label.removeprefix("pass ").replace(" ", "\n") for play in plays]
    axes.set_xticks(places, names)
    axes.set(title="(c) Errors of each play", xlabel="pass", ylabel="error (% of swing)")
    axes.legend(loc="upper right")
