import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from piezod.records.experiment_result import ExperimentResult, Identification
from piezod.records.reference import Reference
from piezod.records.report import write_report
from tests.conftest import leave_figures_blank

_VOID = {"meta", "img", "link", "br", "hr", "input"}


class _Page(HTMLParser):
    """Content of a report: attributes of all elements, tables, and text by element."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text: dict[str, list[str]] = {}
        self.rows: dict[str, list[list[str]]] = {}
        self.values: dict[str, list[float]] = {}
        self._open: list[str] = []
        self._table = ""
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.elements.append((tag, given))
        if tag not in _VOID:
            self._open.append(tag)
            self.text.setdefault(tag, []).append("")
        if tag == "table":
            self._table = given["id"]
            self.rows[self._table] = []
            self.values[self._table] = []
        elif tag == "tr":
            self.rows[self._table].append([])
        elif tag in {"td", "th"}:
            self.rows[self._table][-1].append("")
        elif tag == "data":
            self.values[self._table].append(float(given["value"]))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in set(self._open):
            self.text[tag][-1] += data
        if {"td", "th"} & set(self._open):
            self.rows[self._table][-1][-1] += data

    def given(self, tag: str, name: str) -> list[str]:
        return [attributes[name] for each, attributes in self.elements if each == tag]


@pytest.fixture(scope="module")
def folder(
    tmp_path_factory: pytest.TempPathFactory, result: ExperimentResult, reference: Reference
) -> Path:
    """Return the folder with the report of the synthetic experiment; its figures are blank."""
    folder = tmp_path_factory.mktemp("report") / "new"
    with pytest.MonkeyPatch.context() as patch:
        leave_figures_blank(patch)
        write_report(folder, result, reference)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> _Page:
    """Return the parsed page of the synthetic experiment."""
    return _Page((folder / "report.html").read_text(encoding="utf-8"))


def test_page_needs_nothing_else(folder: Path, page: _Page) -> None:
    """No element loads another file: images are embedded, links stay within the page."""
    anchors = {attributes["id"] for _, attributes in page.elements if "id" in attributes}
    tags = {tag for tag, _ in page.elements}

    assert all(src.startswith("data:image/png;base64,") for src in page.given("img", "src"))
    assert {href.removeprefix("#") for href in page.given("a", "href")} <= anchors
    assert not tags & {"script", "link", "iframe", "object", "base"}
    assert not re.search(r"https?:|url\(|@import", (folder / "report.html").read_text("utf-8"))


def test_header_says_what_ran(page: _Page, result: ExperimentResult) -> None:
    """Title, rate, seed and versions are at the top; characters of HTML appear as plain text."""
    assert page.text["h1"] == [result.title]
    assert page.text["title"] == [result.title]
    assert dict(zip(page.text["dt"], page.text["dd"], strict=True)) == {
        "loop rate": "100 Hz",
        "seed": "7",
        "piezod": "0.1.0",
        "numpy": "2.4",
    }


def test_table_holds_the_metrics(page: _Page, result: ExperimentResult) -> None:
    """The table has the exact value of every metric of every run, in the order of the runs."""
    assert page.values["error-table"] == [
        value for each in result.recordings for value in each.metrics.values()
    ]


def test_table_is_read_without_colours(page: _Page) -> None:
    """Best and missed errors have a sign and a word, and the reference has a column."""
    head, *rows = page.rows["error-table"]

    assert head == [
        "case",
        "mode",
        "worst tracking error (%)",
        "rms tracking error (%)",
        "nonlinearity (%)",
        "paper",
    ]
    assert [[" ".join(cell.split()) for cell in row] for row in rows[:4]] == [
        ["case 1", "uncompensated", "6.60", "3.96", "6.00", "–"],
        ["feedforward", "0.82 ▲ above", "0.49", "0.75 ▲ above", "0.70"],
        ["adaptive", "0.28 ● best", "0.17 ● best", "0.25 ● best", "0.40"],
        ["b", "uncompensated", "6.60", "3.96", "6.00", "–"],
    ]
    assert page.text["strong"] == ["2 of 4 measured errors exceed the figure of the paper."]


def test_every_picture_says_what_it_shows(page: _Page) -> None:
    """Images have a description with the errors."""
    alts = page.given("img", "alt")

    assert len(alts) == len(set(alts)) == 10
    assert alts[-1] == (
        "Voltage, displacement, loop, error and parameters of b, mode adaptive: "
        "worst tracking error 0.28 %, rms tracking error 0.17 %, nonlinearity 0.25 %."
    )


def test_figures_are_grouped_by_case(page: _Page) -> None:
    """The order of sections is: errors, model, each case with its modes, configuration."""
    assert page.text["h2"] == [
        "Errors",
        "Model",
        "case 1: case 1, made up",
        "b: b, made up",
        "Configuration",
    ]
    assert page.text["h3"] == ["uncompensated", "feedforward", "adaptive"] * 2


def test_model_says_how_it_was_made(page: _Page) -> None:
    """The method, its record and its errors are in the table of models."""
    assert page.rows["model-table"][1] == [
        "x",
        "least-squares",
        "decaying triangle",
        "worst voltage error 1.23 %, rms voltage error 0.31 %",
    ]


def test_configuration_is_word_for_word(page: _Page, result: ExperimentResult) -> None:
    """The text of the configuration file is at the end, unchanged."""
    assert page.text["pre"] == [result.configuration]


def test_light_dark_and_print_are_provided_for(folder: Path) -> None:
    """The page has rules for dark screens and for print."""
    text = (folder / "report.html").read_text(encoding="utf-8")

    assert "@media (prefers-color-scheme: dark)" in text
    assert "@media print" in text


def test_pictures_lie_beside_the_page(folder: Path) -> None:
    """Every figure is a PNG beside the page, with the name of the run."""
    assert sorted(each.name for each in folder.iterdir()) == [
        "case_01_x_case_1.png",
        "case_02_x_b.png",
        "model_1_x.png",
        "overview.png",
        "report.html",
        "run_01_x_case_1_uncompensated.png",
        "run_02_x_case_1_feedforward.png",
        "run_03_x_case_1_adaptive.png",
        "run_04_x_b_uncompensated.png",
        "run_05_x_b_feedforward.png",
        "run_06_x_b_adaptive.png",
    ]


@pytest.mark.usefixtures("blank_figures")
def test_same_experiment_gives_the_same_page(
    tmp_path: Path, result: ExperimentResult, reference: Reference
) -> None:
    """Two writes give the same bytes: the page has no time of writing; sizes are the figures'."""
    one = replace(result, recordings=result.recordings[1:2])

    first = write_report(tmp_path / "a", one, reference)
    second = write_report(tmp_path / "b", one, reference)

    assert first == tmp_path / "a" / "report.html"
    assert first.read_bytes() == second.read_bytes()
    page = _Page(first.read_text(encoding="utf-8"))
    assert set(page.given("img", "width")) == {"1"}


@pytest.mark.usefixtures("blank_figures")
def test_axes_are_named_where_there_are_several(tmp_path: Path, two_axes: ExperimentResult) -> None:
    """With two axes the table has a column for them, and headings contain their names."""
    few = replace(two_axes, recordings=(two_axes.recordings[2], two_axes.recordings[8]))

    page = _Page(write_report(tmp_path, few).read_text(encoding="utf-8"))

    assert [row[:3] for row in page.rows["error-table"]] == [
        ["case", "axis", "mode"],
        ["case 1", "x", "adaptive"],
        ["case 1", "y", "adaptive"],
    ]
    assert page.text["h2"][2:4] == [
        "case 1, axis x: case 1, made up",
        "case 1, axis y: case 1, made up",
    ]


@pytest.mark.usefixtures("blank_figures")
def test_reached_references_are_said_so(
    tmp_path: Path, result: ExperimentResult, reference: Reference
) -> None:
    """If all errors are within the reference, a sentence states it."""
    best = replace(result, recordings=result.recordings[2:3])

    page = _Page(write_report(tmp_path, best, reference).read_text(encoding="utf-8"))

    assert page.text["strong"] == [
        "All 2 measured errors are at or below the figures of the paper."
    ]


@pytest.mark.usefixtures("blank_figures")
def test_true_errors_have_a_heading_of_their_own(
    tmp_path: Path, simulated: ExperimentResult, true_reference: Reference
) -> None:
    """Measured, true and noise are side by side, and the page states what is compared."""
    few = replace(simulated, recordings=simulated.recordings[1:3])

    page = _Page(write_report(tmp_path, few, true_reference).read_text(encoding="utf-8"))

    assert page.rows["error-table"][:2] == [
        ["case", "mode", "measured", "true", "noise", "paper"],
        [
            *("worst error (%)", "rms error (%)", "nonlinearity (%)"),
            *("worst error (%)", "nonlinearity (%)"),
            "rms (%)",
        ],
    ]
    spans = [int(each["colspan"]) for tag, each in page.elements if "colspan" in each]
    assert spans == [3, 2, 1]
    assert page.text["strong"] == ["All 4 true errors are at or below the figures of the paper."]
    assert (
        "Compared with the paper: worst true tracking error, true nonlinearity."
        in page.text["caption"][0]
    )
    assert "True: from the simulated stage." in page.text["caption"][0]


@pytest.mark.usefixtures("blank_figures")
def test_without_reference_nothing_is_compared(tmp_path: Path, result: ExperimentResult) -> None:
    """Without a reference there is no column and no sentence about it."""
    one = replace(result, recordings=result.recordings[:1])

    page = _Page(write_report(tmp_path, one).read_text(encoding="utf-8"))

    assert "paper" not in page.rows["error-table"][0]
    assert "strong" not in page.text


@pytest.mark.usefixtures("blank_figures")
def test_error_without_a_value_is_a_dash(tmp_path: Path, result: ExperimentResult) -> None:
    """A missing error is a dash, marked only if it has a limit."""
    failed = replace(result.recordings[0], metrics={"nonlinearity_pct": float("nan")})
    limits = Reference("paper", {("case 1", "uncompensated"): 0.7}, ("nonlinearity_pct",))

    def cell(reference: Reference | None) -> str:
        only = replace(result, recordings=(failed,))
        path = write_report(tmp_path, only, reference)
        return _Page(path.read_text(encoding="utf-8")).rows["error-table"][1][2].strip()

    assert cell(None) == "–"
    assert cell(limits) == "– ▲ no figure"


def test_model_from_a_file_has_no_figure(tmp_path: Path, result: ExperimentResult) -> None:
    """A model that was not fitted to a record is listed without errors and without a picture."""
    none = np.empty(0)
    loaded = Identification("x", "model.yaml", "read from file", none, none, none, none)
    bare = replace(result, recordings=(), identifications=(loaded,))

    page = _Page(write_report(tmp_path, bare).read_text(encoding="utf-8"))

    assert page.rows["model-table"][1] == ["x", "read from file", "model.yaml", "–"]
    assert page.given("img", "alt") == []


@pytest.mark.usefixtures("blank_figures")
def test_warnings_stand_before_the_errors(tmp_path: Path, result: ExperimentResult) -> None:
    """Warnings come first, unchanged, with a link to them."""
    warned = replace(result, recordings=result.recordings[:1], warnings=("a < b", "c & d"))

    page = _Page(write_report(tmp_path, warned).read_text(encoding="utf-8"))

    assert page.text["h2"][:2] == ["Warnings", "Errors"]
    assert page.text["li"][-2:] == ["a < b", "c & d"]
    assert page.given("a", "href")[:2] == ["#warnings", "#errors"]


def test_without_warnings_there_is_no_word_of_them(folder: Path) -> None:
    """There is neither a heading nor a link."""
    assert "Warnings" not in (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("blank_figures")
def test_a_case_without_a_title_has_no_colon(tmp_path: Path, result: ExperimentResult) -> None:
    """The heading is the name alone."""
    untitled = replace(result.recordings[0], title="")

    text = write_report(tmp_path, replace(result, recordings=(untitled,))).read_text("utf-8")

    assert _Page(text).text["h2"][2] == "case 1"


@pytest.mark.usefixtures("blank_figures")
def test_figures_of_an_earlier_report_are_removed_and_nothing_else(
    tmp_path: Path, result: ExperimentResult
) -> None:
    """A shorter run leaves no figures of a longer one; foreign files stay."""
    foreign = {"run_09_mine.png", "overview_2.png", "notes.txt"}
    for name in foreign:
        (tmp_path / name).write_bytes(b"mine")
    evil = '<figure id="run_09_mine">'
    write_report(tmp_path, replace(result, title=evil, configuration=f"{evil}\n{evil}"))

    write_report(tmp_path, replace(result, recordings=result.recordings[:1], identifications=()))

    ours = {"overview.png", "report.html", "run_01_x_case_1_uncompensated.png"}
    assert {each.name for each in tmp_path.iterdir()} == foreign | ours


def test_figures_are_vectors_too_if_asked(tmp_path: Path, result: ExperimentResult) -> None:
    """Beside each PNG there is an SVG and a PDF, which go when the figure goes."""
    one = replace(result, recordings=result.recordings[:1], identifications=())
    write_report(tmp_path, one, vector=True)
    images = {each.name for each in tmp_path.glob("*.png")}
    beside = {f"{Path(name).stem}{ending}" for name in images for ending in (".svg", ".pdf")}

    assert images | beside | {"report.html"} == {each.name for each in tmp_path.iterdir()}

    write_report(tmp_path, replace(one, recordings=result.recordings[1:2]))
    left = {each.name for each in tmp_path.glob("run_*")}
    assert left == {f"run_01_{'_'.join(result.recordings[1].key).replace(' ', '_')}.png"}


@pytest.mark.usefixtures("blank_figures")
def test_a_page_of_somebody_else_removes_nothing(tmp_path: Path, result: ExperimentResult) -> None:
    """Figures of a foreign page stay, and its text need not be UTF-8."""
    (tmp_path / "report.html").write_bytes(b'\xff\n<figure id="holiday">\n<figure id="../run_01">')
    (tmp_path / "holiday.png").write_bytes(b"mine")

    write_report(tmp_path, replace(result, recordings=result.recordings[:1]))

    assert (tmp_path / "holiday.png").read_bytes() == b"mine"
