"""The figure that compares the errors of all modes in all cases."""

import math
from collections.abc import Iterable, Mapping
from itertools import cycle
from typing import Final, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

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
from piezod.records.labels import metric_label, metric_number, metric_unit
from piezod.records.recording import ExperimentResult, Recording
from piezod.records.reference import Reference, is_missed

_ROW_IN: Final = 0.27


class _Mark(NamedTuple):
    shape: str
    colour: str
    size: float = 7.0
    edge: float = 1.0

    def line(self, values: list[float], rows: list[int], label: str = "") -> Line2D:
        return Line2D(
            values,
            rows,
            linestyle="",
            marker=self.shape,
            color=self.colour,
            markersize=self.size,
            markeredgewidth=self.edge,
            label=label,
        )


# Modes differ in shape as well as in colour, and look the same in every figure.
_MODE_MARKS: Final = {
    "uncompensated": _Mark("o", GREY),
    "feedforward": _Mark("s", BLUE),
    "adaptive": _Mark("D", GREEN),
}
_OTHER_MARKS: Final = (
    _Mark("^", VERMILLION),
    _Mark("v", PURPLE),
    _Mark("P", ORANGE),
)
_REFERENCE_MARK: Final = _Mark("|", BLACK, size=14.0, edge=1.8)


@house_style()
def overview_figure(result: ExperimentResult, reference: Reference | None = None) -> Figure:
    """Draw every metric of every recording as a dot, beside the figures of the reference.

    Args:
        result: The experiment, with at least one recording that has metrics.
        reference: Errors to compare with, where there are any.
    """
    headlines, rows = _layout(result)
    height_in = 1.4 + _ROW_IN * (len(headlines) + len(rows))
    figure = new_figure(13.0, height_in, "Errors of the measured displacement", "")
    names = result.metric_names
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    marks = _marks(result.modes)
    for axes, name in zip(panels, names, strict=True):
        _draw_metric(axes, name, rows, marks, reference)
        for y in list(headlines)[1:]:
            axes.axhline(y - 0.5, color="#BBBBBB", linewidth=0.7)
    _label_rows(panels[0], headlines, rows)
    handles = [marks[mode].line([], [], mode) for mode in result.modes]
    if reference is not None:
        handles.append(_REFERENCE_MARK.line([], [], reference.label))
    figure.legend(handles=handles, loc="upper right", ncols=len(handles))
    return figure


def _marks(modes: Iterable[str]) -> dict[str, _Mark]:
    """Return the mark of each mode: that of its name, or the next one that is free."""
    others = cycle(_OTHER_MARKS)
    return {mode: _MODE_MARKS.get(mode) or next(others) for mode in modes}


def _layout(result: ExperimentResult) -> tuple[dict[int, str], dict[int, Recording]]:
    """Return what stands at which height, counted downwards: headlines, and recordings."""
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
    axes.set_ylim(max(texts) + 0.6, -0.6)


def _draw_metric(
    axes: Axes,
    name: str,
    rows: Mapping[int, Recording],
    marks: Mapping[str, _Mark],
    reference: Reference | None,
) -> None:
    unit = metric_unit(name)
    axes.set_title(metric_label(name))
    axes.set_xlabel("% of range" if unit == "%" else unit)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    shown = {y: recording for y, recording in rows.items() if name in recording.metrics}
    drawn: list[float] = []
    for y, recording in shown.items():
        value = recording.metrics[name]
        limit = reference.limit(recording, name) if reference else None
        axes.add_line(marks[recording.mode].line([value], [y]))
        if limit is not None:
            axes.add_line(_REFERENCE_MARK.line([limit], [y]))
            drawn.append(limit)
        drawn.append(value)
        text = metric_number(name, value)
        if limit is not None:
            text += f" {'>' if is_missed(value, limit) else '≤'} {metric_number(name, limit)}"
        _write_at_right(axes, y, text, bold=is_missed(value, limit))
    _set_scale(axes, drawn)


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


def _set_scale(axes: Axes, values: Iterable[float]) -> None:
    """Show ratios, from under one percent to many, wherever all values have a logarithm."""
    finite = [value for value in values if math.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    if low <= 0:
        axes.set_xlim(min(low, 0.0) - 0.05 * (high - low), high + 0.5 * (high - low) + 1e-9)
        return
    axes.set_xscale("log")
    # A third of the panel stays free at the right, for the numbers.
    axes.set_xlim(low / 1.5, high * (high / low) ** 0.5 * 1.5)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
