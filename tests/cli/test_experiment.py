"""`piezod experiment`."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.experiment.progress import Progress
from piezod.experiment.virtual.run import run_experiment
from piezod.records.csv_file import write_csv
from piezod.records.experiment_file import read_hdf5
from piezod.records.experiment_result import ExperimentResult
from tests.cli.conftest import Command

MODES = ["uncompensated", "feedforward", "adaptive"]
RESULTS: dict[tuple[str, str], ExperimentResult] = {}


@pytest.fixture
def run_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run equal experiments once, because the run takes longer than everything else."""

    def known(
        config: ExperimentConfig, configuration: str, title: str, progress: Progress
    ) -> ExperimentResult:
        key = repr(config), configuration
        if key not in RESULTS:
            RESULTS[key] = run_experiment(config, configuration, title, progress)
        return RESULTS[key]

    monkeypatch.setattr("piezod.cli.experiment.run.run_experiment", known)


@pytest.mark.usefixtures("run_once")
def test_document(piezod: Command, experiment_file: Path, folder: Path) -> None:
    """With --json, stdout is one document with a row for each run; no progress is shown.

    The figures are drawn, as those of no other experiment in short tests.
    """
    code, out, err = piezod("experiment", experiment_file, "--json")

    assert (code, err) == (0, "")
    document = json.loads(out)
    rows = document["cases"]
    assert [(row["case"], row["mode"]) for row in rows] == [("slow", mode) for mode in MODES]
    assert all(0.0 < row["tracking_rms_pct"] < row["tracking_max_pct"] for row in rows)
    assert all(row["nonlinearity_pct"] < 20.0 for row in rows)
    assert document["model"]["method"] == "least-squares"
    assert document["model"]["axes"]["x"]["voltage_error_max_pct"] < 5.0
    assert document["seed"] == 3
    assert document["report"] == "short-results/report.html"
    assert (folder / document["report"]).is_file()
    assert (folder / document["data"]).is_file()


@pytest.mark.usefixtures("blank_figures")
def test_text(piezod: Command, experiment_file: Path, folder: Path) -> None:
    """The text has the errors, the origin of the model, and the path of the report."""
    text = experiment_text(folder, experiment_file)
    limits = "    reference_pct: {feedforward: 0.01, adaptive: 90}\nreference: others\n"
    (folder / experiment_file).write_text(text + limits, encoding="utf-8")

    code, out, err = piezod("experiment", experiment_file, "--out", "here")

    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert [row[0] for row in rows if row and row[0] in MODES[1:]] == MODES[1:]
    assert "Measured: from the sensor." in out
    (feedforward,) = [line for line in out.splitlines() if line.split()[:1] == ["feedforward"]]
    assert feedforward.count("▲") == 2
    assert feedforward.endswith(" 0.01")
    assert "2 of 4 measured errors exceed the figure of the others." in out
    assert "Model of axis x by least-squares, " in out
    assert out.endswith("Report: here/report.html\n")


@pytest.mark.usefixtures("blank_figures", "run_once")
def test_true_errors_fit_into_80_columns(
    piezod: Command, experiment_file: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Measured errors, true errors and noise fit side by side, and are in the document."""
    monkeypatch.setenv("COLUMNS", "80")
    text = experiment_text(folder, experiment_file)
    names = ["tracking_max_pct", "tracking_rms_pct", "nonlinearity_pct"]
    names += ["true_tracking_max_pct", "true_nonlinearity_pct", "noise_rms_pct"]
    compared = "    reference_pct: {feedforward: 0.01}\nreference: paper\n"
    asked = f"{text}{compared}metrics: [{', '.join(names)}]\n"
    (folder / experiment_file).write_text(asked, encoding="utf-8")

    out = piezod("experiment", experiment_file).out
    rows = json.loads(piezod("experiment", experiment_file, "--json").out)["cases"]

    head, _, titles, rule, *_ = out.splitlines()
    assert head.split() == ["measured", "true", "noise"]
    assert titles.split() == [
        *("case", "mode", "error", "error", "earity", "error", "earity", "rms", "paper"),
    ]
    assert len(rule) < 80
    (feedforward,) = [line for line in out.splitlines() if line.split()[:1] == ["feedforward"]]
    assert feedforward.split()[4:7:2] == ["▲", "▲"]
    assert "2 of 2 true errors exceed the figure of the paper." in out
    assert list(rows[0]) == ["axis", "case", "mode", *names]
    assert all(0.02 < row["noise_rms_pct"] < 0.2 for row in rows)


@pytest.mark.usefixtures("blank_figures")
def test_two_axes_are_named(piezod: Command, experiment_file: Path, folder: Path) -> None:
    """With several axes the table names them, and every axis has its model."""
    text = experiment_text(folder, experiment_file)
    start, end = text.index("  x:\n"), text.index("identification:")
    second = text[start:end].replace("  x:", "  y:")
    (folder / experiment_file).write_text(text[:end] + second + text[end:], encoding="utf-8")

    code, out, err = piezod("experiment", experiment_file)

    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    firsts = [row[:4] for row in rows if row[3:4] == ["uncompensated"]]
    assert firsts == [
        ["slow,", "axis", "x", "uncompensated"],
        ["slow,", "axis", "y", "uncompensated"],
    ]
    assert "Model of axis x by" in out
    assert "Model of axis y by" in out
    assert "exceed" not in out


def experiment_text(folder: Path, file: Path) -> str:
    """Return the text of an experiment file."""
    return (folder / file).read_text(encoding="utf-8")


@pytest.mark.usefixtures("blank_figures")
def test_seed_is_used_and_kept(piezod: Command, experiment_file: Path, folder: Path) -> None:
    """Another seed gives another stage; the same seed gives the same data to the bit."""
    text = experiment_text(folder, experiment_file)
    (folder / experiment_file).write_text(f"{text}modes: [adaptive]\n", encoding="utf-8")

    def errors(seed: int) -> list[dict[str, object]]:
        out = piezod("experiment", experiment_file, "--seed", seed, "--json").out
        assert json.loads(out)["seed"] == seed
        cases: list[dict[str, object]] = json.loads(out)["cases"]
        return cases

    first, second = errors(4), errors(5)

    assert first != second
    assert errors(4) == first
    assert read_hdf5(folder / "short-results" / "experiment.h5").seed == 4


@pytest.mark.usefixtures("blank_figures")
def test_model_file_takes_the_place_of_identification(
    piezod: Command, experiment_file: Path, folder: Path
) -> None:
    """A model file of `identify` replaces the identification, with its delay."""
    text = experiment_text(folder, experiment_file)
    no_deadband = "    compensator: {deadband_pct: 0}\n"  # as `identify` has none
    text = text.replace("identification:", no_deadband + "identification:")
    (folder / experiment_file).write_text(text, encoding="utf-8")
    first = json.loads(piezod("experiment", experiment_file, "--out", "first", "--json").out)
    (record,) = read_hdf5(folder / "first" / "experiment.h5").identifications
    columns = record.columns()
    write_csv(
        folder / "data.csv", {name: columns[name] for name in ("t_s", "drive_v", "position_um")}
    )
    options = ("--delay-s", "auto", "--thresholds", "even", "--order", 19)
    assert piezod("identify", "data.csv", *options, "--out", "stage.yaml").code == 0
    head, tail = text.split("identification:")
    rest = tail[tail.index("settle_s: 0.5\ncases") :]
    (folder / "from_model.yaml").write_text(
        f"{head}    model: stage.yaml\n{rest}", encoding="utf-8"
    )

    code, out, err = piezod("experiment", "from_model.yaml", "--json")

    assert (code, err) == (0, "")
    document = json.loads(out)
    model = document["model"]["axes"]["x"]
    assert model["source"] == "model file stage.yaml"
    assert model["delay_s"] > 0.0005
    assert model["delay_s"] == pytest.approx(first["model"]["axes"]["x"]["delay_s"])
    uncompensated, feedforward, _ = (row["nonlinearity_pct"] for row in document["cases"])
    assert feedforward < 0.5 * uncompensated


@pytest.mark.usefixtures("blank_figures", "run_once")
def test_warnings_are_in_every_output(piezod: Command, experiment_file: Path, folder: Path) -> None:
    """A warning is in the text, the document, the report and the data."""
    document = json.loads(piezod("experiment", experiment_file, "--json").out)
    out = piezod("experiment", experiment_file).out

    (warning,) = document["warnings"]
    assert warning.startswith("Axis x: The drive has one frequency.")
    assert f"! {warning}" in " ".join(out.split())
    assert warning in (folder / document["report"]).read_text(encoding="utf-8")
    assert read_hdf5(folder / document["data"]).warnings == (warning,)


@pytest.mark.stress
@pytest.mark.usefixtures("run_once")
def test_odd_titles_and_constant_commands(
    piezod: Command, experiment_file: Path, folder: Path, request: pytest.FixtureRequest
) -> None:
    """Mathematical signs are plain text, and a constant command has no error in %."""
    text = experiment_text(folder, experiment_file)
    constant = "  - {name: $x, title: '$\\frac$ x', period_s: 1, duration_s: 1.5, command_um: "
    constant += "{kind: setpoint, level: 10}}\nmodes: [adaptive]\n"
    (folder / experiment_file).write_text(text + constant, encoding="utf-8")

    code, out, err = piezod("experiment", experiment_file, "--json")

    assert (code, err) == (0, "")
    last = json.loads(out)["cases"][-1]
    assert (last["case"], last["nonlinearity_pct"]) == ("$x", None)
    assert last["tracking_max_pct"] is None
    request.getfixturevalue("blank_figures")  # they have been drawn once
    text = piezod("experiment", experiment_file).out
    page = (folder / "short-results" / "report.html").read_text(encoding="utf-8")
    assert "nan" not in text
    assert "▲" not in text
    assert "nonlinearity –" in page
    assert "nan %" not in page


def test_bad_file(piezod: Command, folder: Path) -> None:
    """An invalid file is refused before the run, with nothing on stdout."""
    (folder / "bad.yaml").write_text("rate_hz: 1\n", encoding="utf-8")

    code, out, err = piezod("experiment", "bad.yaml", "--json")

    assert (code, out) == (78, "")
    assert "bad.yaml:1:10: rate_hz: out of range (got 1)" in err
    assert [each.name for each in folder.iterdir()] == ["bad.yaml"]


def test_results_cannot_take_the_place_of_a_file(
    piezod: Command, experiment_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file in place of the folder is refused before the run."""
    monkeypatch.setattr("piezod.cli.experiment.run.run_experiment", None)

    expected = (1, "", "short.yaml: File exists\n")
    assert piezod("experiment", experiment_file, "--out", experiment_file) == expected


def test_folder_that_cannot_be_written_to(
    piezod: Command, experiment_file: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder without write permission is refused before the run."""

    def refuse(**_: object) -> None:
        raise PermissionError(13, "Permission denied", "here/tmp0123")

    (folder / "here").mkdir()
    monkeypatch.setattr("piezod.cli.paths.tempfile", SimpleNamespace(TemporaryFile=refuse))
    monkeypatch.setattr("piezod.cli.experiment.run.run_experiment", None)

    expected = (77, "", "here: cannot be written to: Permission denied\n")
    assert piezod("experiment", experiment_file, "--out", "here") == expected


@pytest.mark.parametrize("seed", ["-1", "4294967296", "one"])
def test_wrong_seed(piezod: Command, experiment_file: Path, seed: str) -> None:
    """A seed outside the range of configurations is wrong usage."""
    code, out, err = piezod("experiment", experiment_file, "--seed", seed)

    assert (code, out) == (2, "")
    assert "'--seed'" in err
