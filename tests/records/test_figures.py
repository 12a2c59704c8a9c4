import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from piezod.records.experiment_result import ExperimentResult, Identification, Recording
from piezod.records.figures import (
    case_figure,
    identification_figure,
    mode_figure,
    overview_figure,
    png_bytes,
    remaining_figure,
    save_png,
)
from piezod.records.figures.play import PlayedErrors, play_figure
from piezod.records.figures.style import ERROR_LABEL, house_style
from piezod.records.reference import Reference


def _panel(figure: Figure, title: str) -> Axes:
    (panel,) = [axes for axes in figure.axes if axes.get_title(loc="left").startswith(title)]
    return panel


def _lines(axes: Axes) -> dict[str, Line2D]:
    return {str(line.get_label()): line for line in axes.lines}


def _xy(line: Line2D) -> tuple[list[float], list[float]]:
    return np.asarray(line.get_xdata()).tolist(), np.asarray(line.get_ydata()).tolist()


@pytest.fixture(scope="module")
def run(recording: Recording) -> Figure:
    """Return the figure of the synthetic run, which tests only read."""
    return mode_figure(recording)


@pytest.fixture(scope="module")
def true_run(simulated: ExperimentResult) -> Figure:
    """Return the figure of a run whose true displacement is known, which tests only read."""
    return mode_figure(simulated.recordings[2])


def test_run_has_the_panels_of_the_paper_and_two_more(run: Figure) -> None:
    """Panels (a) to (e) have titles, and units on every labelled axis."""
    assert {
        axes.get_title(loc="left"): (axes.get_xlabel(), axes.get_ylabel()) for axes in run.axes
    } == {
        "(a) Voltage": ("", "voltage (V)"),
        "(b) Displacement": ("", "displacement (µm)"),
        "(c) Loop": ("uncompensated voltage (V)", "measured displacement (µm)"),
        "(d) Error": ("time (s)", ERROR_LABEL),
        "(e) Parameters": ("time (s)", "weight"),
    }


def test_run_names_itself_and_its_errors(run: Figure) -> None:
    """The headline contains case, mode, axis, waveform, and the metrics with their unit."""
    assert run.get_suptitle() == (
        "case 1 · adaptive · axis x: case 1, made up\n"
        "worst tracking error 0.28 %, rms tracking error 0.17 %, nonlinearity 0.25 %"
    )


def test_run_fills_most_of_a_screen(run: Figure) -> None:
    """Its size in pixels is that of 13 by 8 inches."""
    assert tuple(run.bbox.size) == (1625, 1000)


def test_run_shows_the_recorded_columns(recording: Recording, run: Figure) -> None:
    """Each line of a run holds the column that its label names."""
    t_s = recording.t_s.tolist()
    voltage, position = _lines(_panel(run, "(a)")), _lines(_panel(run, "(b)"))

    assert _xy(voltage["applied to the stage"]) == (t_s, recording.drive_v.tolist())
    assert _xy(voltage["uncompensated"]) == (t_s, recording.uncompensated_v.tolist())
    assert _xy(position["measured"]) == (t_s, recording.position_um.tolist())
    assert _xy(position["command"]) == (t_s, recording.command_um.tolist())
    assert _xy(_panel(run, "(d)").lines[0]) == (t_s, recording.error_um.tolist())


def test_true_error_is_drawn_on_top_of_the_measured_one(
    simulated: ExperimentResult, run: Figure, true_run: Figure
) -> None:
    """If it is not known, there is neither a line nor a legend entry for it."""
    known = simulated.recordings[2]
    panel = _panel(true_run, "(d)")
    lines = _lines(panel)
    assert _xy(lines["measured"]) == (known.t_s.tolist(), known.error_um.tolist())
    assert _xy(lines["true"]) == (known.t_s.tolist(), known.true_error_um.tolist())
    assert lines["true"].get_color() != lines["measured"].get_color()
    assert "true" not in _lines(_panel(run, "(d)"))


def test_stage_below_its_command_has_a_positive_error(recording: Recording) -> None:
    """An experiment and a played waveform have the sign that the status has."""
    below = replace(recording, position_um=recording.command_um - 1.0)
    played = PlayedErrors("pass 1", np.full(8, 1.0), (1.0, 1.0), (np.nan, np.nan))
    motion = play_figure("", 0.1, np.zeros(8), [played], (0,), {})
    for figure, panel in ((mode_figure(below), "(d)"), (case_figure([below]), "(b)")):
        assert np.allclose(_xy(_panel(figure, panel).lines[0])[1], 1.0)
    for panel, drawn_um in (("(a)", -1.0), ("(b)", 1.0)):
        assert set(_xy(_panel(motion, panel).lines[0])[1]) == {drawn_um}


def test_true_error_is_explained_where_every_sample_counts(simulated: ExperimentResult) -> None:
    """The legend does not need an excluded part."""
    panel = _panel(mode_figure(replace(simulated.recordings[2], first_metric_index=0)), "(d)")
    legend = panel.get_legend()

    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["measured", "true"]


def test_true_errors_have_a_line_of_their_own_in_the_headline(true_run: Figure) -> None:
    """All six errors in one line would not fit."""
    headline = true_run.get_suptitle()

    assert headline.splitlines()[1:] == [
        "worst tracking error 0.28 %, rms tracking error 0.17 %, nonlinearity 0.25 %",
        "worst true tracking error 0.21 %, true nonlinearity 0.19 %, rms sensor noise 0.06 %",
    ]
    true_run.draw_without_rendering()
    (text,) = [each for each in true_run.findobj(Text) if each.get_text() == headline]
    assert text.get_window_extent().x1 < true_run.bbox.x1


def test_headline_has_the_true_error_even_if_it_is_no_metric(recording: Recording) -> None:
    """The panel shows the true error, so the headline has it beside the measured one."""
    known = replace(recording, true_um=recording.command_um + 0.1)
    headline = mode_figure(known).get_suptitle()

    range_um = np.ptp(known.true_um[known.first_metric_index :])
    assert headline.splitlines()[-1] == f"worst true tracking error {10.0 / range_um:.2f} %"


def test_what_a_published_figure_lacks_is_a_figure_of_its_own(
    recording: Recording, run: Figure
) -> None:
    """It has the panels (d) and (e) of the run, with the same headline."""
    figure = remaining_figure(recording)

    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == ["(d) Error", "(e) Parameters"]
    assert _xy(_panel(figure, "(d)").lines[0])[1] == recording.error_um.tolist()
    assert figure.get_suptitle() == run.get_suptitle()


def test_largest_parameters_are_labelled(recording: Recording, run: Figure) -> None:
    """The lines of the largest weights have the numbers of their operators, at their height."""
    panel = _panel(run, "(e) Parameters")
    labels = {text.get_text(): float(text.xy[1]) for text in panel.texts}  # type: ignore[attr-defined]

    right, left = np.split(recording.weights[-1], 2)
    numbered = {f"R{i}": float(w) for i, w in enumerate(right, 1)}
    numbered |= {f"L{i}": float(w) for i, w in enumerate(left, 1)}
    assert labels["L19"] == left[-1] == max(numbered.values())
    assert labels == {name: numbered[name] for name in labels}
    assert 2 <= len(labels) <= 8


def test_parameters_without_sides_are_numbered_through(recording: Recording) -> None:
    """A model whose weights belong to no side has one legend entry."""
    weights = np.tile([0.0, 0.3, 0.1, -0.2, 0.05], (recording.weights_t_s.size, 1))
    panel = _panel(mode_figure(replace(recording, weights=weights, surface=True)), "(e) Parameters")
    labels = {text.get_text(): float(text.xy[1]) for text in panel.texts}  # type: ignore[attr-defined]

    assert labels == {"c1": 0.3, "c3": -0.2, "c2": 0.1, "c4": 0.05, "c0": 0.0}
    legend = panel.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["c0 to c4"]


def test_a_case_has_all_modes_on_the_same_scales(result: ExperimentResult) -> None:
    """Each mode has its line in each panel; the compensated ones have a panel of their own."""
    recordings = result.recordings[:3]
    figure = case_figure(recordings)

    loop, zoomed = (
        _lines(_panel(figure, "(d) Loop")),
        _panel(figure, "(c) Error of the compensated modes"),
    )
    assert [each for each in loop if not each.startswith("_")] == [r.mode for r in recordings]
    assert _xy(loop["adaptive"])[1] == recordings[2].position_um.tolist()
    drawn = _lines(zoomed)
    assert "uncompensated" not in drawn
    assert _xy(drawn["feedforward"])[1] == recordings[1].error_um.tolist()


def test_loop_is_measured_displacement_over_uncompensated_voltage(
    recording: Recording, run: Figure
) -> None:
    """The loop is split at the first sample of the metrics, and the command is a straight line."""
    loop = _lines(_panel(run, "(c)"))
    drive_v, position_um = recording.uncompensated_v.tolist(), recording.position_um.tolist()

    assert list(loop) == ["excluded", "measured", "command"]
    assert _xy(loop["excluded"]) == (drive_v[:201], position_um[:201])
    assert _xy(loop["measured"]) == (drive_v[200:], position_um[200:])
    assert _xy(loop["command"])[0] == [min(drive_v), max(drive_v)]


def test_a_run_that_counts_from_its_first_sample_excludes_nothing(recording: Recording) -> None:
    """If every sample counts, there is no grey part and no legend entry for it."""
    figure = mode_figure(replace(recording, first_metric_index=0))

    assert list(_lines(_panel(figure, "(c)"))) == ["measured", "command"]
    assert _panel(figure, "(d)").get_legend() is None


def test_each_parameter_is_a_line_to_the_end(recording: Recording, run: Figure) -> None:
    """The last value of each weight holds until the end of the record."""
    lines = _panel(run, "(e)").lines

    assert len(lines) == 38
    assert _xy(lines[5]) == (
        [*recording.weights_t_s.tolist(), recording.t_s[-1]],
        [*recording.weights[:, 5].tolist(), recording.weights[-1, 5]],
    )


def test_fixed_parameters_are_level_lines(make_recording: Callable[..., Recording]) -> None:
    """One snapshot of the weights gives horizontal lines over the whole time."""
    recording = make_recording("x", "case 1", "feedforward")

    line = _panel(mode_figure(recording), "(e)").lines[0]

    assert _xy(line) == ([0.0, recording.t_s[-1]], [recording.weights[0, 0]] * 2)


def test_without_compensator_there_are_no_parameters(
    make_recording: Callable[..., Recording],
) -> None:
    """An uncompensated run has only the panels (a) to (d)."""
    titles = [
        axes.get_title(loc="left")[:3]
        for axes in mode_figure(make_recording("x", "case 1", "uncompensated")).axes
    ]

    assert sorted(titles) == ["(a)", "(b)", "(c)", "(d)"]


def test_error_is_shown_in_percent_of_range_too(recording: Recording, run: Figure) -> None:
    """The right-hand scale is the share of the displacement range of the metrics."""
    run.draw_without_rendering()
    panel = _panel(run, "(d)")
    (percent,) = panel.child_axes

    low_um, high_um = panel.get_ylim()
    share = 100 / recording.position_range_um
    assert percent.get_ylabel() == "% of range"
    assert percent.get_ylim() == pytest.approx((low_um * share, high_um * share))


def test_a_stage_that_stood_still_is_drawn(recording: Recording) -> None:
    """A run without motion has no percent scale."""
    still = replace(recording, position_um=np.zeros(400))

    figure = mode_figure(still)

    assert _panel(figure, "(d)").child_axes == []
    assert png_bytes(figure).startswith(b"\x89PNG")


def test_a_constant_command_has_no_percent_scale(recording: Recording) -> None:
    """If only noise moves the displacement, its range is no measure of the error."""
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


@pytest.mark.usefixtures("layout")
def test_legends_cover_no_data(
    recording: Recording, simulated: ExperimentResult, identification: Identification
) -> None:
    """Every legend is above the frame of its panel and beside the panel's title."""
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
    """Measured and predicted voltage appear over time and over displacement, with residuals."""
    figure = identification_figure(identification)
    over_time, loop = _lines(_panel(figure, "(a)")), _lines(_panel(figure, "(b)"))
    t_s, position_um = identification.t_s.tolist(), identification.position_um.tolist()
    residual_v = (identification.predicted_v - identification.drive_v).tolist()

    assert _xy(over_time["measured"]) == (t_s, identification.drive_v.tolist())
    assert _xy(over_time["predicted"]) == (t_s, identification.predicted_v.tolist())
    assert _xy(loop["measured"]) == (position_um, identification.drive_v.tolist())
    assert _xy(loop["predicted"]) == (position_um, identification.predicted_v.tolist())
    assert _xy(_panel(figure, "(c)").lines[0]) == (t_s, residual_v)
    assert _panel(figure, "(c)").get_xlabel() == "time (s)"
    assert _panel(figure, "(d)").get_xlabel() == "measured displacement (µm)"
    assert {axes.get_ylabel() for axes in figure.axes} == {"drive voltage (V)", "residual (V)"}
    assert figure.get_suptitle() == (
        "Model by least-squares · axis x: decaying triangle\n"
        "worst voltage error 1.23 %, rms voltage error 0.31 %"
    )


@pytest.mark.usefixtures("layout")
def test_png_is_the_same_each_time(tmp_path: Path, recording: Recording) -> None:
    """The same record gives the same bytes, in the size of the figure, without a version."""
    path = tmp_path / "run.png"
    save_png(path, remaining_figure(recording))
    first = path.read_bytes()

    assert png_bytes(remaining_figure(recording)) == first
    assert struct.unpack(">II", first[16:24]) == (1625, 525)
    assert b"matplotlib" not in first.lower()


def test_settings_of_the_user_do_not_matter_and_stay(recording: Recording) -> None:
    """A user's matplotlibrc changes no figure, and drawing does not change its settings."""
    png = png_bytes(remaining_figure(recording))
    with mpl.rc_context({"font.size": 30.0, "lines.linewidth": 9.0, "axes.facecolor": "red"}):
        before = dict(mpl.rcParams)
        assert png_bytes(remaining_figure(recording)) == png
        assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(
    "text",
    [
        "$\\frac$ x",
        *(
            pytest.param(text, marks=pytest.mark.stress)
            for text in ("c_dollar$\\frac$.csv", "$x", "$", "a_b^c")
        ),
    ],
)
def test_signs_of_mathematics_are_plain_text(
    recording: Recording,
    identification: Identification,
    result: ExperimentResult,
    reference: Reference,
    text: str,
) -> None:
    """Dollars and backslashes in names and titles appear unchanged."""
    odd = replace(recording, axis=text, case=text, mode=text, title=text)
    figures = [
        mode_figure(odd),
        identification_figure(replace(identification, axis=text, title=text, method=text)),
        overview_figure(replace(result, recordings=(odd,)), replace(reference, label=text)),
    ]

    with house_style():
        for figure in figures:
            figure.draw_without_rendering()  # the layout of a text parses its mathematics
    assert not any(each.get_parse_math() for figure in figures for each in figure.findobj(Text))


def test_a_run_without_a_title_ends_its_headline_at_the_axis(recording: Recording) -> None:
    """The headline has no trailing colon."""
    headline = mode_figure(replace(recording, title="")).get_suptitle().splitlines()[0]

    assert headline == "case 1 · adaptive · axis x"
