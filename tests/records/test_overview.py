"""The figure that compares the errors of all modes in all cases."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from piezod.records.experiment_result import ExperimentResult
from piezod.records.figures import overview_figure, png_bytes
from piezod.records.reference import Reference


def _xy(line: Line2D) -> tuple[list[float], list[float]]:
    return np.asarray(line.get_xdata()).tolist(), np.asarray(line.get_ydata()).tolist()


def test_overview_has_a_dot_for_each_error(result: ExperimentResult, reference: Reference) -> None:
    """Each panel is a metric, with a dot for each run and a bar for each limit."""
    figure = overview_figure(result, reference)

    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "worst tracking error",
        "rms tracking error",
        "nonlinearity",
    ]
    for axes, name in zip(figure.axes, result.metric_names, strict=True):
        dots = [line for line in axes.lines if line.get_marker() not in {"|", "None"}]
        bars = [line for line in axes.lines if line.get_marker() == "|"]
        assert [_xy(dot)[0] for dot in dots] == [[each.metrics[name]] for each in result.recordings]
        assert [_xy(bar)[0] for bar in bars] == (
            [[0.7], [0.4]] if name in reference.metrics else []
        )
        assert axes.get_xlabel() == "% of range"


def test_overview_rows_are_cases_and_modes(
    result: ExperimentResult, two_axes: ExperimentResult
) -> None:
    """Rows have the names of case and mode, and of the axis if there are several."""

    def rows(figure: Figure) -> list[str]:
        return [label.get_text() for label in figure.axes[0].get_yticklabels()]

    modes = ["uncompensated", "feedforward", "adaptive"]
    assert rows(overview_figure(result)) == ["case 1", *modes, "b", *modes]
    assert rows(overview_figure(two_axes))[::4] == [
        "case 1, axis x",
        "b, axis x",
        "case 1, axis y",
        "b, axis y",
    ]


def test_overview_marks_errors_above_their_limit(
    result: ExperimentResult, reference: Reference
) -> None:
    """Beside each dot is its value, with the limit and the relation sign."""
    texts = [text.get_text() for text in overview_figure(result, reference).axes[2].texts]

    assert texts == ["6.00", "0.75 > 0.70", "0.25 ≤ 0.40", "6.00", "0.75", "0.25"]


def test_overview_shows_true_errors_as_open_dots(
    simulated: ExperimentResult, true_reference: Reference
) -> None:
    """They share the panel of the measured errors, which are filled; noise has its own panel."""
    figure = overview_figure(simulated, true_reference)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    nonlinearity = figure.axes[2]
    dots = [line for line in nonlinearity.lines if line.get_marker() in {"o", "s", "D"}]
    filled = [_xy(dot)[0][0] for dot in dots if dot.get_markerfacecolor() == dot.get_color()]
    unfilled = [_xy(dot)[0][0] for dot in dots if dot.get_markerfacecolor() == "white"]

    assert figure.get_suptitle() == "Errors of the displacement: measured (filled) / true (open)"
    assert titles == [
        *("worst tracking error", "rms tracking error", "nonlinearity"),
        "rms sensor noise",
    ]
    assert filled == [each.metrics["nonlinearity_pct"] for each in simulated.recordings]
    assert unfilled == [each.metrics["true_nonlinearity_pct"] for each in simulated.recordings]
    assert [text.get_text() for text in nonlinearity.texts][:3] == [
        "6.00 / 4.50",
        "0.75 / 0.56 ≤ 0.70",
        "0.25 / 0.19 ≤ 0.40",
    ]


def test_overview_of_true_errors_alone(simulated: ExperimentResult) -> None:
    """Without measured errors the panel has the name of the true error."""
    only = [
        replace(each, metrics={"true_nonlinearity_pct": each.metrics["true_nonlinearity_pct"]})
        for each in simulated.recordings
    ]
    (panel,) = overview_figure(replace(simulated, recordings=tuple(only))).axes

    assert panel.get_title(loc="left") == "true nonlinearity"


@pytest.mark.usefixtures("layout")
def test_numbers_in_the_overview_cover_no_dot(
    simulated: ExperimentResult, true_reference: Reference
) -> None:
    """They are to the right of all dots of their panel."""
    figure = overview_figure(simulated, true_reference)
    figure.draw_without_rendering()
    for axes in figure.axes:
        drawn = [line.get_window_extent().x1 for line in axes.lines if line.get_marker() != "None"]

        assert max(drawn) < min(text.get_window_extent().x0 for text in axes.texts)


@pytest.mark.usefixtures("layout")
def test_labels_of_an_axis_stand_clear_of_each_other(
    simulated: ExperimentResult, true_reference: Reference
) -> None:
    """This holds for any number of decades."""
    tiny = replace(simulated.recordings[2], metrics=dict.fromkeys(simulated.metric_names, 0.02))
    recordings = (*simulated.recordings[:2], tiny, *simulated.recordings[3:])
    figure = overview_figure(replace(simulated, recordings=recordings), true_reference)
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [each.get_window_extent() for each in axes.get_xticklabels()]

        assert len(boxes) > 1
        assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_modes_differ_in_shape_as_well_as_in_colour(result: ExperimentResult) -> None:
    """The legend shows a different shape and colour for every mode."""
    (legend,) = overview_figure(result).legends
    handles = [each for each in legend.legend_handles if isinstance(each, Line2D)]

    assert [text.get_text() for text in legend.get_texts()] == list(result.modes)
    assert len({str(each.get_marker()) for each in handles}) == 3
    assert len({str(each.get_color()) for each in handles}) == 3


def test_a_mode_looks_the_same_in_every_figure(result: ExperimentResult) -> None:
    """Colour and shape depend on the mode's name only."""

    def looks(*modes: str) -> dict[str, tuple[str, str]]:
        recordings = tuple(replace(result.recordings[0], mode=mode) for mode in modes)
        (legend,) = overview_figure(replace(result, recordings=recordings)).legends
        handles = [each for each in legend.legend_handles if isinstance(each, Line2D)]
        return {
            mode: (str(handle.get_marker()), str(handle.get_color()))
            for mode, handle in zip(modes, handles, strict=True)
        }

    known = looks("uncompensated", "feedforward", "adaptive", "trimmed")
    odd = looks("other", "adaptive", "another", "feedforward")

    assert {mode: odd[mode] for mode in ("adaptive", "feedforward")} == {
        mode: known[mode] for mode in ("adaptive", "feedforward")
    }
    assert looks("adaptive")["adaptive"] == known["adaptive"]
    assert len({*known.values(), *odd.values()}) == 6


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_overview_of_odd_errors(result: ExperimentResult, value: float) -> None:
    """Errors without a logarithm, or NaN, are drawn or at least written."""
    odd = [replace(each, metrics={"nonlinearity_pct": value}) for each in result.recordings]

    figure = overview_figure(replace(result, recordings=tuple(odd)))

    assert png_bytes(figure).startswith(b"\x89PNG")
    written = "–" if math.isnan(value) else f"{value:.2f}"
    assert {text.get_text() for text in figure.axes[0].texts} == {written}
