import math
import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from piezod.records.figures import (
    identification_figure,
    mode_figure,
    overview_figure,
    png_bytes,
    save_png,
)
from piezod.records.recording import ExperimentResult, Identification, Recording
from piezod.records.reference import Reference


def _panel(figure: Figure, title: str) -> Axes:
    (panel,) = [axes for axes in figure.axes if axes.get_title(loc="left").startswith(title)]
    return panel


def _lines(axes: Axes) -> dict[str, Line2D]:
    return {str(line.get_label()): line for line in axes.lines}


def _xy(line: Line2D) -> tuple[list[float], list[float]]:
    return np.asarray(line.get_xdata()).tolist(), np.asarray(line.get_ydata()).tolist()


def test_run_has_the_panels_of_the_paper_and_two_more(recording: Recording) -> None:
    """Panels (a) to (e) are there, with what they show and its unit on every labelled axis."""
    figure = mode_figure(recording)

    assert {
        axes.get_title(loc="left"): (axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes
    } == {
        "(a) Voltage": ("", "voltage (V)"),
        "(b) Displacement": ("", "displacement (µm)"),
        "(c) Loop": ("uncompensated voltage (V)", "measured displacement (µm)"),
        "(d) Error: measured minus command": ("time (s)", "error (µm)"),
        "(e) Parameters": ("time (s)", "weight"),
    }


def test_run_names_itself_and_its_errors(recording: Recording) -> None:
    """The headline says case, mode, axis, waveform, and the metrics with their unit."""
    assert mode_figure(recording).get_suptitle() == (
        "case 1 · adaptive · axis x: case 1, made up\n"
        "worst tracking error 0.28 %, rms tracking error 0.17 %, nonlinearity 0.25 %"
    )


def test_run_shows_the_recorded_columns(recording: Recording) -> None:
    """Each line of a run holds the column that its label names."""
    figure = mode_figure(recording)
    t_s = recording.t_s.tolist()
    voltage, position = _lines(_panel(figure, "(a)")), _lines(_panel(figure, "(b)"))

    assert _xy(voltage["applied to the stage"]) == (t_s, recording.drive_v.tolist())
    assert _xy(voltage["uncompensated"]) == (t_s, recording.uncompensated_v.tolist())
    assert _xy(position["measured"]) == (t_s, recording.position_um.tolist())
    assert _xy(position["command"]) == (t_s, recording.command_um.tolist())
    assert _xy(_panel(figure, "(d)").lines[0]) == (t_s, recording.error_um.tolist())


def test_true_error_is_drawn_upon_the_measured_one(
    simulated: ExperimentResult, recording: Recording
) -> None:
    """Where it is known; elsewhere there is neither a line nor a word of it."""
    known = simulated.recordings[2]
    panel = _panel(mode_figure(known), "(d)")
    lines = _lines(panel)

    assert panel.get_title(loc="left") == "(d) Error"
    assert _xy(lines["measured"]) == (known.t_s.tolist(), known.error_um.tolist())
    assert _xy(lines["true"]) == (known.t_s.tolist(), known.true_error_um.tolist())
    assert lines["true"].get_color() != lines["measured"].get_color()
    assert "true" not in _lines(_panel(mode_figure(recording), "(d)"))


def test_true_error_is_explained_where_every_sample_counts(simulated: ExperimentResult) -> None:
    """The legend does not depend on there being an excluded part."""
    panel = _panel(mode_figure(replace(simulated.recordings[2], first_metric_index=0)), "(d)")
    legend = panel.get_legend()

    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["measured", "true"]


def test_true_errors_have_a_line_of_their_own_in_the_headline(simulated: ExperimentResult) -> None:
    """All six in one line would be cut off at the right."""
    figure = mode_figure(simulated.recordings[2])
    headline = figure.get_suptitle()

    assert headline.splitlines()[1:] == [
        "worst tracking error 0.28 %, rms tracking error 0.17 %, nonlinearity 0.25 %",
        "worst true tracking error 0.21 %, true nonlinearity 0.19 %, rms sensor noise 0.06 %",
    ]
    figure.draw_without_rendering()
    (text,) = [each for each in figure.findobj(Text) if each.get_text() == headline]
    assert text.get_window_extent().x1 < figure.bbox.x1


def test_loop_is_measured_displacement_over_uncompensated_voltage(recording: Recording) -> None:
    """The loop parts at the first sample of the metrics, and the command is a straight line."""
    loop = _lines(_panel(mode_figure(recording), "(c)"))
    drive_v, position_um = recording.uncompensated_v.tolist(), recording.position_um.tolist()

    assert list(loop) == ["excluded", "measured", "command"]
    assert _xy(loop["excluded"]) == (drive_v[:201], position_um[:201])
    assert _xy(loop["measured"]) == (drive_v[200:], position_um[200:])
    assert _xy(loop["command"])[0] == [min(drive_v), max(drive_v)]


def test_a_run_that_counts_from_its_first_sample_excludes_nothing(recording: Recording) -> None:
    """Where every sample counts there is no grey part and no word of it."""
    figure = mode_figure(replace(recording, first_metric_index=0))

    assert list(_lines(_panel(figure, "(c)"))) == ["measured", "command"]
    assert _panel(figure, "(d)").get_legend() is None


def test_each_parameter_is_a_line_to_the_end(recording: Recording) -> None:
    """There is a line for each weight; its last value holds until the end of the record."""
    lines = _panel(mode_figure(recording), "(e)").lines

    assert len(lines) == 38
    assert _xy(lines[5]) == (
        [*recording.weights_t_s.tolist(), recording.t_s[-1]],
        [*recording.weights[:, 5].tolist(), recording.weights[-1, 5]],
    )


def test_fixed_parameters_are_level_lines(make_recording: Callable[..., Recording]) -> None:
    """One snapshot of the weights gives lines over the whole time."""
    recording = make_recording("x", "case 1", "feedforward")

    line = _panel(mode_figure(recording), "(e)").lines[0]

    assert _xy(line) == ([0.0, recording.t_s[-1]], [recording.weights[0, 0]] * 2)


def test_without_compensator_there_are_no_parameters(
    make_recording: Callable[..., Recording],
) -> None:
    """An uncompensated run has the panels (a) to (d) only."""
    titles = [
        axes.get_title(loc="left")[:3]
        for axes in mode_figure(make_recording("x", "case 1", "uncompensated")).axes
    ]

    assert sorted(titles) == ["(a)", "(b)", "(c)", "(d)"]


def test_error_is_shown_in_percent_of_range_too(recording: Recording) -> None:
    """The right-hand scale of the error is its share of the displacement range that counts."""
    figure = mode_figure(recording)
    figure.draw_without_rendering()
    panel = _panel(figure, "(d)")
    (percent,) = panel.child_axes

    low_um, high_um = panel.get_ylim()
    share = 100 / recording.position_range_um
    assert percent.get_ylabel() == "% of range"
    assert percent.get_ylim() == pytest.approx((low_um * share, high_um * share))


def test_a_stage_that_stood_still_is_drawn(recording: Recording) -> None:
    """A run without motion has no percent scale, and is drawn all the same."""
    still = replace(recording, position_um=np.zeros(400))

    figure = mode_figure(still)

    assert _panel(figure, "(d)").child_axes == []
    assert png_bytes(figure).startswith(b"\x89PNG")


def test_a_constant_command_has_no_percent_scale(recording: Recording) -> None:
    """Where only noise moves the stage, its range is no measure of the error."""
    noise_um = 0.01 * np.sin(np.arange(400.0))
    held = replace(
        recording,
        command_um=np.full(400, 10.0),
        position_um=10.0 + noise_um,
        uncompensated_v=np.full(400, 50.0),
        metrics={"nonlinearity_pct": float("nan")},
    )

    figure = mode_figure(held)

    assert _panel(figure, "(d)").child_axes == []
    assert figure.get_suptitle().endswith("\nnonlinearity –")
    assert png_bytes(figure).startswith(b"\x89PNG")


def test_invalid_samples_leave_gaps(recording: Recording) -> None:
    """NaN in the displacement is drawn as a gap, without a warning."""
    position_um = recording.position_um.copy()
    position_um[100:120] = np.nan

    figure = mode_figure(replace(recording, position_um=position_um))

    assert png_bytes(figure).startswith(b"\x89PNG")


def test_legends_cover_no_data(
    recording: Recording, simulated: ExperimentResult, identification: Identification
) -> None:
    """Every legend stands above the frame of its panel, clear of the panel's title."""
    figures = [mode_figure(recording), mode_figure(simulated.recordings[2])]
    for figure in (*figures, identification_figure(identification)):
        figure.draw_without_rendering()
        legends = {axes: legend for axes in figure.axes if (legend := axes.get_legend())}
        assert len(legends) > 1
        for axes, legend in legends.items():
            (title,) = _texts(axes, axes.get_title(loc="left"))
            assert legend.get_window_extent().y0 >= axes.get_window_extent().y1
            assert legend.get_window_extent().x0 > title.get_window_extent().x1


def _texts(axes: Axes, words: str) -> list[Text]:
    return [text for text in axes.findobj(Text) if text.get_text() == words]


def test_model_and_data_are_shown(identification: Identification) -> None:
    """Measured and predicted voltage are there over time and over displacement, and residuals."""
    figure = identification_figure(identification)
    over_time, loop = _lines(_panel(figure, "(a)")), _lines(_panel(figure, "(b)"))
    t_s, position_um = identification.t_s.tolist(), identification.position_um.tolist()
    residual_v = (identification.predicted_v - identification.drive_v).tolist()

    assert _xy(over_time["measured"]) == (t_s, identification.drive_v.tolist())
    assert _xy(over_time["predicted"]) == (t_s, identification.predicted_v.tolist())
    assert _xy(loop["measured"]) == (position_um, identification.drive_v.tolist())
    assert _xy(loop["predicted"]) == (position_um, identification.predicted_v.tolist())
    assert _xy(_panel(figure, "(c)").lines[0]) == (t_s, residual_v)
    assert _xy(_panel(figure, "(d)").lines[0]) == (position_um, residual_v)
    assert _panel(figure, "(c)").get_xlabel() == "time (s)"
    assert _panel(figure, "(d)").get_xlabel() == "measured displacement (µm)"
    assert {axes.get_ylabel() for axes in figure.axes} == {"drive voltage (V)", "residual (V)"}
    assert figure.get_suptitle() == (
        "Model by least-squares · axis x: decaying triangle\n"
        "worst voltage error 1.23 %, rms voltage error 0.31 %"
    )


def test_overview_has_a_dot_for_each_error(result: ExperimentResult, reference: Reference) -> None:
    """Each panel of the overview is a metric, with a dot for each run and a bar for each limit."""
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
    """Rows are named by case and mode, and by axis where there are several."""

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


def test_overview_says_what_exceeds_its_limit(
    result: ExperimentResult, reference: Reference
) -> None:
    """Beside each dot stands its value, with the limit and the relation in signs."""
    texts = [text.get_text() for text in overview_figure(result, reference).axes[2].texts]

    assert texts == ["6.00", "0.75 > 0.70", "0.25 ≤ 0.40", "6.00", "0.75", "0.25"]


def test_overview_shows_true_errors_as_open_dots(
    simulated: ExperimentResult, true_reference: Reference
) -> None:
    """They share the panel of the measured ones, which are filled; noise has its own."""
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
    """Without a measured counterpart the panel bears the name of the true error."""
    only = [
        replace(each, metrics={"true_nonlinearity_pct": each.metrics["true_nonlinearity_pct"]})
        for each in simulated.recordings
    ]
    (panel,) = overview_figure(replace(simulated, recordings=tuple(only))).axes

    assert panel.get_title(loc="left") == "true nonlinearity"


def test_numbers_in_the_overview_cover_no_dot(
    simulated: ExperimentResult, true_reference: Reference
) -> None:
    """They stand to the right of all that is drawn in their panel."""
    figure = overview_figure(simulated, true_reference)
    figure.draw_without_rendering()
    for axes in figure.axes:
        drawn = [line.get_window_extent().x1 for line in axes.lines if line.get_marker() != "None"]

        assert max(drawn) < min(text.get_window_extent().x0 for text in axes.texts)


def test_labels_of_an_axis_stand_clear_of_each_other(
    simulated: ExperimentResult, true_reference: Reference
) -> None:
    """However many decades the errors span."""
    tiny = replace(simulated.recordings[2], metrics=dict.fromkeys(simulated.metric_names, 0.02))
    recordings = (*simulated.recordings[:2], tiny, *simulated.recordings[3:])
    figure = overview_figure(replace(simulated, recordings=recordings), true_reference)
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [each.get_window_extent() for each in axes.get_xticklabels()]

        assert len(boxes) > 1
        assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_modes_differ_in_shape_as_well_as_in_colour(result: ExperimentResult) -> None:
    """The legend shows a shape and a colour of its own for every mode."""
    (legend,) = overview_figure(result).legends
    handles = [each for each in legend.legend_handles if isinstance(each, Line2D)]

    assert [text.get_text() for text in legend.get_texts()] == list(result.modes)
    assert len({str(each.get_marker()) for each in handles}) == 3
    assert len({str(each.get_color()) for each in handles}) == 3


def test_a_mode_looks_the_same_in_every_figure(result: ExperimentResult) -> None:
    """Colour and shape belong to the mode's name, whatever other modes there are."""

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
    """Errors without a logarithm, or that are no numbers, are drawn or at least written."""
    odd = [replace(each, metrics={"nonlinearity_pct": value}) for each in result.recordings]

    figure = overview_figure(replace(result, recordings=tuple(odd)))

    assert png_bytes(figure).startswith(b"\x89PNG")
    written = "–" if math.isnan(value) else f"{value:.2f}"
    assert {text.get_text() for text in figure.axes[0].texts} == {written}


def test_png_is_the_same_each_time(tmp_path: Path, recording: Recording) -> None:
    """The same record gives the same bytes, of the size that the figure has, without a version."""
    path = tmp_path / "run.png"
    save_png(path, mode_figure(recording))
    first = path.read_bytes()

    assert png_bytes(mode_figure(recording)) == first
    assert struct.unpack(">II", first[16:24]) == (1625, 1000)
    assert b"matplotlib" not in first.lower()


def test_settings_of_the_user_do_not_matter_and_stay(recording: Recording) -> None:
    """A matplotlibrc of the user's changes no figure, and drawing changes none of its settings."""
    plain = png_bytes(mode_figure(recording))

    with mpl.rc_context({"font.size": 30.0, "lines.linewidth": 9.0, "axes.facecolor": "red"}):
        before = dict(mpl.rcParams)
        assert png_bytes(mode_figure(recording)) == plain
        assert dict(mpl.rcParams) == before


@pytest.mark.parametrize("text", ["$\\frac$ x", "c_dollar$\\frac$.csv", "$x", "$", "a_b^c"])
def test_signs_of_mathematics_are_plain_text(
    recording: Recording,
    identification: Identification,
    result: ExperimentResult,
    reference: Reference,
    text: str,
) -> None:
    """Names and titles with dollars and backslashes are written as they are."""
    odd = replace(recording, axis=text, case=text, mode=text, title=text)
    figures = [
        mode_figure(odd),
        identification_figure(replace(identification, axis=text, title=text, method=text)),
        overview_figure(replace(result, recordings=(odd,)), replace(reference, label=text)),
    ]

    assert all(png_bytes(figure).startswith(b"\x89PNG") for figure in figures)
    assert not any(each.get_parse_math() for figure in figures for each in figure.findobj(Text))


def test_a_run_without_a_title_ends_its_headline_at_the_axis(recording: Recording) -> None:
    """No colon stands before nothing."""
    headline = mode_figure(replace(recording, title="")).get_suptitle().splitlines()[0]

    assert headline == "case 1 · adaptive · axis x"
