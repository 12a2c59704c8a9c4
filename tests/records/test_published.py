import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezod.records.experiment_result import ExperimentResult, Recording
from piezod.records.figures import published_figure
from piezod.records.reference import Reference
from piezod.records.report import write_report

FIGURES = {
    ("case 1", "feedforward"): "Fig. 6",
    ("case 1", "adaptive"): "Fig. 9",
    ("b", "feedforward"): "Fig. 7",
    ("b", "adaptive"): "Fig. 10",
}


@pytest.fixture
def published(reference: Reference) -> Reference:
    """Return the reference, with a figure for each compensated run."""
    return replace(reference, figures=FIGURES)


def test_panels_are_those_of_the_paper(recording: Recording, published: Reference) -> None:
    """Both voltages, the measured displacement, and the latter over the uncompensated voltage."""
    figure = published_figure(recording, published)

    drawn = {
        axes.get_title(loc="left")[:3]: [
            (np.asarray(line.get_xdata()).tolist(), np.asarray(line.get_ydata()).tolist())
            for line in axes.lines
        ]
        for axes in figure.axes
    }
    t_s, reference_v, drive_v, position_um = (
        getattr(recording, name).tolist()
        for name in ("t_s", "uncompensated_v", "drive_v", "position_um")
    )
    assert drawn == {
        "(a)": [(t_s, reference_v), (t_s, drive_v)],
        "(b)": [(t_s, position_um)],
        "(c)": [(reference_v, position_um)],
    }


def test_axes_have_units(recording: Recording, published: Reference) -> None:
    """The time axis is shared by (a) and (b)."""
    voltage, position, loop = published_figure(recording, published).axes

    assert voltage.get_ylabel() == "voltage (V)"
    assert (position.get_xlabel(), position.get_ylabel()) == ("time (s)", "displacement (µm)")
    assert loop.get_xlabel() == "uncompensated voltage (V)"
    assert loop.get_ylabel() == "measured displacement (µm)"
    assert voltage.get_xlim() == position.get_xlim()


def test_errors_are_beside_the_published_one(recording: Recording, published: Reference) -> None:
    """The headline has the figure of the paper, our compared errors, and the paper's error."""
    assert published_figure(recording, published).get_suptitle() == (
        "As in Fig. 9 of the paper · case 1 · adaptive · axis x: case 1, made up\n"
        "here: worst tracking error 0.28 %, nonlinearity 0.25 % · paper: 0.40 %"
    )


def test_a_figure_without_a_published_error_has_ours(
    recording: Recording, published: Reference
) -> None:
    """Without a published error only our errors are in the headline."""
    figure = published_figure(replace(recording, case="b"), published)

    assert figure.get_suptitle().endswith(
        "\nhere: worst tracking error 0.28 %, nonlinearity 0.25 %"
    )


@pytest.mark.usefixtures("blank_figures")
def test_report_has_the_figures_in_the_order_of_the_paper(
    tmp_path: Path, result: ExperimentResult, published: Reference
) -> None:
    """The page has the published figures in one section; the runs link to them."""
    page = write_report(tmp_path, result, published).read_text(encoding="utf-8")

    assert re.findall(r"<h3>As in (Fig. \d+) of the paper", page) == [
        "Fig. 6", "Fig. 7", "Fig. 9", "Fig. 10",
    ]  # fmt: skip
    assert re.findall(r'<a href="#(published_\w+)">As in (Fig. \d+)', page) == [
        ("published_01_x_case_1_feedforward", "Fig. 6"),
        ("published_03_x_case_1_adaptive", "Fig. 9"),
        ("published_02_x_b_feedforward", "Fig. 7"),
        ("published_04_x_b_adaptive", "Fig. 10"),
    ]
    assert (tmp_path / "published_04_x_b_adaptive.png").exists()
    assert "Error and parameters of b, mode adaptive: worst" in page
    assert "Voltage, displacement, loop and error of b, mode uncompensated: worst" in page


@pytest.mark.usefixtures("blank_figures")
def test_published_figures_of_an_earlier_report_are_removed(
    tmp_path: Path, result: ExperimentResult, published: Reference
) -> None:
    """A later report without published figures leaves none behind."""
    write_report(tmp_path, result, published)

    write_report(tmp_path, result)

    assert not list(tmp_path.glob("published_*"))
    assert "published" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_no_panel_is_drawn_twice(
    tmp_path: Path, result: ExperimentResult, published: Reference, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run with a published figure has a second one for error and parameters only."""
    drawn: list[tuple[str, str]] = []
    for name in ("mode_figure", "remaining_figure", "published_figure"):

        def note(recording: Recording, *_: object, name: str = name) -> str:
            drawn.append((name, recording.mode))
            return name

        monkeypatch.setattr(f"piezod.records.report_figures.{name}", note)
    blank = b"\x89PNG\r\n\x1a\n" + bytes(16)
    monkeypatch.setattr("piezod.records.report_figures.png_bytes", lambda _: blank)
    one_case = replace(result, recordings=result.recordings[:3])

    write_report(tmp_path, one_case, published)

    assert drawn == [
        ("published_figure", "feedforward"),
        ("published_figure", "adaptive"),
        ("mode_figure", "uncompensated"),
        ("remaining_figure", "feedforward"),
        ("remaining_figure", "adaptive"),
    ]
