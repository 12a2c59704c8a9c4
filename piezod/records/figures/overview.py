"""The figure that compares the errors of all modes in all cases."""

import math
from collections.abc import Iterable, Mapping
from itertools import cycle
from typing import Final, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from piezod.records.experiment_result import ExperimentResult, Recording
from piezod.records.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILLION,
    house_style,
    new_figure,
)
from piezod.records.labels import metric_group, metric_label, metric_number, metric_unit
from piezod.records.reference import Reference, is_missed

_ROW_IN: Final = 0.27
_WIDE_RATIO: Final = 30.0
"""Ratio of the largest to the smallest error above which an axis has fewer tick labels."""


class Dot(NamedTuple):
    """Appearance of a dot."""

    shape: str  #: Name of the matplotlib marker.
    colour: str  #: Colour of edge and filling.
    size: float = 7.0  #: Size in points.
    edge: float = 1.0  #: Width of the edge, in points.

    def line(
        self, values: list[float], rows: list[int], label: str = "", *, filled: bool = True
    ) -> Line2D:
        """Return dots without a line between them, open or filled."""
        return Line2D(
            values,
            rows,
            linestyle="",
            marker=self.shape,
            color=self.colour,
            markerfacecolor=self.colour if filled else "white",
            markersize=self.size,
            markeredgewidth=self.edge,
            label=label,
        )


MODE_MARKS: Final = {
    "uncompensated": Dot("o", GREY),
    "feedforward": Dot("s", BLUE),
    "adaptive": Dot("D", GREEN),
    "trimmed": Dot("^", VERMILLION),
    "closed": Dot("p", BLACK),
}
"""Modes differ in shape as well as in colour, and look the same in every figure."""
_OTHER_MARKS: Final = (
    Dot("v", PURPLE),
    Dot("P", ORANGE),
)
_REFERENCE_MARK: Final = Dot("|", BLACK, size=14.0, edge=1.8)


@house_style()
def overview_figure(result: ExperimentResult, reference: Reference | None = None) -> Figure:
    """Draw every metric of every recording as a dot, beside the values of the reference.

    A metric of the true displacement is an open dot in the panel of the measured one.

    Args:
        result: The experiment, with at least one recording that has metrics.
        reference: Errors to compare with, if any.
    """
    headlines, rows = _layout(result)
    height_in = 1.4 + _ROW_IN * (len(headlines) + len(rows))
    panels = _panels(result.metric_names)
    figure = new_figure(13.0, height_in, _headline(result.metric_names), "")
    # A panel with two numbers per row is wider.
    widths = {"width_ratios": [3 + len(names) for names in panels]}
    all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False, gridspec_kw=widths)[0]
    marks = mode_marks(result.modes)
    for axes, names in zip(all_axes, panels, strict=True):
        _draw_metrics(axes, names, rows, marks, reference)
        for y in list(headlines)[1:]:  # a rule between the cases
            axes.axhline(y - 0.5, color="#BBBBBB", linewidth=0.7)
    _label_rows(all_axes[0], headlines, rows)
    handles = [marks[mode].line([], [], mode) for mode in result.modes]
    if reference is not None:
        handles.append(_REFERENCE_MARK.line([], [], reference.label))
    figure.legend(handles=handles, loc="upper right", ncols=len(handles))
    return figure


def _headline(metrics: Iterable[str]) -> str:
    if "true" in map(metric_group, metrics):
        return "Errors of the displacement: measured (filled) / true (open)"
    return "Errors of the measured displacement"


def _panels(metrics: Iterable[str]) -> list[tuple[str, ...]]:
    """Return the metrics of each panel: one, or a measured one and its true counterpart."""
    panels: dict[str, list[str]] = {}
    for name in metrics:
        panels.setdefault(name.removeprefix("true_"), []).append(name)
    return [tuple(sorted(names, key=metric_group)) for names in panels.values()]


def mode_marks(modes: Iterable[str]) -> dict[str, Dot]:
    """Return the mark of each mode: that of its name, or the next free one."""
    others = cycle(_OTHER_MARKS)
    return {mode: MODE_MARKS.get(mode) or next(others) for mode in modes}


def _layout(result: ExperimentResult) -> tuple[dict[int, str], dict[int, Recording]]:
    """Return headlines and recordings by their row, counted from the top."""
    headlines: dict[int, str] = {}
    rows: dict[int, Recording] = {}
    for (axis, case), recordings in result.by_case().items():
        top = len(headlines) + len(rows)
        headlines[top] = f"{case}, axis {axis}" if len(result.axes) > 1 else case
        rows.update(enumerate(recordings, top + 1))
    return headlines, rows


def _label_rows(axes: Axes, headlines: dict[int, str], rows: dict[int, Recording]) -> None:
    modes = {y: recording.mode for y, recording in rows.items()}
    texts = dict(sorted((headlines | modes).items()))
    axes.set_yticks(list(texts), labels=list(texts.values()))
    for y, label in zip(texts, axes.get_yticklabels(), strict=True):
        label.set_fontweight("bold" if y in headlines else "normal")
    axes.set_ylim(max(texts) + 0.6, -0.6)  # rows are counted from the top


def _draw_metrics(
    axes: Axes,
    names: tuple[str, ...],
    rows: Mapping[int, Recording],
    marks: Mapping[str, Dot],
    reference: Reference | None,
) -> None:
    unit = metric_unit(names[0])
    axes.set_title(metric_label(names[0]))
    axes.set_xlabel("% of range" if unit == "%" else unit)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    drawn: list[float] = []
    for y, recording in rows.items():
        limits = {name: reference.limit(recording, name) if reference else None for name in names}
        values = {name: recording.metrics[name] for name in names if name in recording.metrics}
        for name, value in values.items():
            filled = metric_group(name) != "true"
            axes.add_line(marks[recording.mode].line([value], [y], filled=filled))
            limit = limits[name]
            if limit is not None:
                axes.add_line(_REFERENCE_MARK.line([limit], [y]))
                drawn.append(limit)
            drawn.append(value)
        text = " / ".join(_text(name, value, limits[name]) for name, value in values.items())
        missed = any(is_missed(value, limits[name]) for name, value in values.items())
        _write_at_right(axes, y, text, bold=missed)
    _set_scale(axes, drawn, room=len(names))


def _text(name: str, value: float, limit: float | None) -> str:
    text = metric_number(name, value)
    if limit is None:
        return text
    return f"{text} {'>' if is_missed(value, limit) else '≤'} {metric_number(name, limit)}"


def _write_at_right(axes: Axes, y: int, text: str, *, bold: bool) -> None:
    axes.text(
        0.99,
        y,
        text,
        transform=axes.get_yaxis_transform(),
        ha="right",
        va="center",
        fontsize=9,
        fontweight="bold" if bold else "normal",
    )


def _set_scale(axes: Axes, values: Iterable[float], room: int) -> None:
    """Use a logarithmic scale if all values are positive.

    Args:
        axes: The panel.
        values: The drawn values.
        room: Number of texts at the right, where no dot is drawn.
    """
    finite = [value for value in values if math.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    if low <= 0:
        axes.set_xlim(min(low, 0.0) - 0.05 * (high - low), high + 0.5 * room * (high - low) + 1e-9)
        return
    axes.set_xscale("log")
    # A third of the panel stays free at the right for one number, half of it for two.
    axes.set_xlim(low / 1.5, high * (high / low) ** (0.5 * room) * 1.5)
    # Labels at 1, 2 and 5 of each decade overlap if there are many decades.
    steps = (1.0, 2.0, 5.0) if high < _WIDE_RATIO * low else (1.0, 3.0)
    low, high = low / 1.5, high * 1.5
    ticks = LogLocator(subs=steps).tick_values(low, high)
    axes.set_xticks([tick for tick in ticks if low <= tick <= high])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
