"""`piezod identify`: the chosen model, its errors and its uncertainty."""

import json
import re
from pathlib import Path

import pytest

from piezod.cli.identify.run import FitJob
from piezod.experiment.fit.automatic import Choice, Wanted, choose
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from tests.cli.conftest import Command
from tests.experiment.made_up import record_of, swells, write_record

AUTO = ("--method", "auto")


@pytest.fixture
def data(folder: Path) -> Path:
    """Return a data file of a made-up stage that creeps, with noise."""
    write_record(folder / "data.csv", record_of(path=swells, creep=0.004, noise=0.001))
    return Path("data.csv")


CHOICES: dict[bytes, Choice] = {}


@pytest.fixture
def chosen_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Choose once for each record, because the choice takes seconds."""

    def known(record: Record, wanted: Wanted, delay_s: float | None, *_progress: object) -> Choice:
        key = record.position_um.tobytes()
        if key not in CHOICES:
            CHOICES[key] = choose(record, wanted, delay_s)
        return CHOICES[key]

    monkeypatch.setattr("piezod.experiment.fit.file.choose", known)


@pytest.mark.usefixtures("chosen_once")
def test_text_has_the_candidates_and_the_choice(piezod: Command, data: Path) -> None:
    """The text has the candidates, the chosen one, and the reason."""
    code, out, err = piezod("identify", "--verbose", data, *AUTO, "--delay-s", 0)

    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    tried = [row for row in rows if row and row[0] in set(Method)]
    assert 20 < len(tried) < 50
    assert {row[1] for row in tried} == {"even", "graded", "placed", "–"}
    document = json.loads(
        piezod("identify", "--verbose", data, *AUTO, "--delay-s", 0, "--json").out
    )
    candidates = document["choice"]["candidates"]
    marks = ["taken" if each["taken"] else "best" if each["best"] else "" for each in candidates]
    assert [row[-1] if row[-1] in {"best", "taken"} else "" for row in tried] == marks
    (taken,) = re.findall(r"Taken: (.*?)\.\s", " ".join(out.split()))
    assert "a surface does not count, because the record does not have loops" in taken


@pytest.mark.usefixtures("chosen_once")
def test_tables_fit_a_terminal_of_80_columns(
    piezod: Command, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No cell is cut, in the widest tables: candidates, and errors with creep, without, and raw."""
    monkeypatch.setenv("COLUMNS", "80")

    code, out, _ = piezod("identify", "--verbose", data, *AUTO, "--delay-s", 0, "--test", data)

    assert code == 0
    assert "…" not in out  # rich cuts a word that is too wide, and breaks a line of words
    assert out.count("5 blocks, held out") == out.count("test, no constant") == 2
    assert re.search(r"with creep: +without creep: +raw:", out)


@pytest.mark.usefixtures("chosen_once")
def test_document_has_the_choice(piezod: Command, data: Path) -> None:
    """The chosen model has at most the parameters of the best, and an error within the limit."""
    document = json.loads(
        piezod("identify", "--verbose", data, *AUTO, "--delay-s", 0, "--json").out
    )

    choice = document["choice"]
    (best,) = [each for each in choice["candidates"] if each["best"]]
    (taken,) = [each for each in choice["candidates"] if each["taken"]]
    assert taken["parameters"] <= best["parameters"]
    assert best["position_error_rms_pct"] <= taken["position_error_rms_pct"]
    assert taken["position_error_rms_pct"] <= choice["limit_rms_pct"]
    for key in ("method", "order", "thresholds", "creep"):
        assert document[key] == taken[key]
    assert document["creep"] is True
    assert document["creep_per_decade"] == pytest.approx(0.008, rel=0.3)


@pytest.mark.parametrize(
    ("options", "fixed"),
    [
        (("--order", 8), {"order": 8}),
        (("--thresholds", "even", "--no-creep"), {"thresholds": "even", "creep": False}),
        (("--creep", "--order", 5), {"creep": True, "order": 5, "method": "least-squares"}),
    ],
)
@pytest.mark.few(1)
def test_given_options_are_not_chosen(
    piezod: Command, data: Path, options: tuple[object, ...], fixed: dict[str, object]
) -> None:
    """All candidates have the given properties."""
    arguments = ("identify", "--verbose", data, *AUTO, "--delay-s", 0, *options, "--json")
    document = json.loads(piezod(*arguments).out)

    for candidate in document["choice"]["candidates"]:
        assert {key: candidate[key] for key in fixed} == fixed
    assert {key: document[key] for key in fixed} == fixed


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--method", "least-squares"), ("least-squares", 19, "graded", False)),
        (("--order", "7"), ("least-squares", 7, "graded", False)),
        (("--creep", "--thresholds", "placed"), ("least-squares", 19, "placed", True)),
        (("--method", "lms"), ("lms", 19, "even", False)),
        (("--method", "surface"), ("surface", None, None, True)),
        (("--method", "surface", "--no-creep"), ("surface", None, None, False)),
    ],
)
@pytest.mark.few(2)
def test_without_a_choice_there_are_defaults(
    piezod: Command, data: Path, options: tuple[str, ...], expected: tuple[object, ...]
) -> None:
    """Thresholds are graded, and even with the paper's method; a surface is fitted with creep."""
    document = json.loads(
        piezod("identify", "--verbose", data, "--delay-s", 0, *options, "--json").out
    )

    assert tuple(document[key] for key in ("method", "order", "thresholds", "creep")) == expected
    assert document["choice"] is None


def test_creep_by_lms_is_wrong_usage(piezod: Command, data: Path) -> None:
    """Creep with LMS is refused before the fit."""
    code, out, err = piezod("identify", "--verbose", data, "--method", "lms", "--creep")

    assert (code, out) == (2, "")
    assert "'--creep': creep is fitted by least-squares and surface, not by lms" in err


@pytest.mark.parametrize("option", [("--order", "8"), ("--thresholds", "even")])
def test_a_surface_has_no_operators(piezod: Command, data: Path, option: tuple[str, str]) -> None:
    """Number and thresholds of operators are refused with a surface."""
    code, out, err = piezod("identify", "--verbose", data, "--method", "surface", *option)

    assert (code, out) == (2, "")
    assert f"'{option[0]}': a surface has no operators; leave the option out" in err


@pytest.mark.usefixtures("chosen_once")
def test_auto_is_the_default(piezod: Command, data: Path) -> None:
    """Without a method and without operators, the model is chosen."""
    default, chosen = (
        json.loads(piezod("identify", "--verbose", data, *options, "--delay-s", 0, "--json").out)
        for options in ((), AUTO)
    )

    assert default["choice"] is not None
    assert default == chosen


def test_axis_that_refuses_a_surface_gets_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The identifiers of the paper learn operators only, so that no surface is tried."""
    asked: list[object] = []

    def identify_file(_file: Path, *, settings: object, **_: object) -> None:
        asked.append(settings)

    monkeypatch.setattr("piezod.cli.identify.run.identify_file", identify_file)
    job = FitJob(None, 0.0, None, Wanted(creep=True))
    for takes_surface in (True, False):
        job.fit(Path("data.csv"), 0.0, takes_surface)

    assert asked == [Wanted(creep=True), Wanted(creep=True, surface=False)]


def test_blocks_and_raw_displacement_are_in_the_document(piezod: Command, data: Path) -> None:
    """The document has the errors of each block: with and without creep, and unsmoothed."""
    options = ("--method", "least-squares", "--delay-s", 0)
    document = json.loads(piezod("identify", "--verbose", data, *options, "--json").out)

    assert document["cross_validation"] == document["without_creep"]["cross_validation"]
    for which in ("with_creep", "without_creep", "raw_displacement"):
        validation = document[which]["cross_validation"]
        assert len(validation["blocks"]) == 5
        worst = max(block["voltage_error_max_pct"] for block in validation["blocks"])
        assert validation["voltage_error_max_pct"] == worst
    with_creep = document["with_creep"]["cross_validation"]
    assert (
        with_creep["voltage_error_rms_pct"] < document["cross_validation"]["voltage_error_rms_pct"]
    )


@pytest.mark.usefixtures("fitted_once")
def test_a_constant_offset_is_named(piezod: Command, data: Path, folder: Path) -> None:
    """The constant offset removed from the test is reported in % and µm."""
    other = record_of(path=swells, creep=0.004, noise=0.001)
    other.position_um[:] += 0.5
    write_record(folder / "other.csv", other)
    arguments = ("identify", "--verbose", data, "--test", "other.csv", "--delay-s", 0, "--creep")

    document = json.loads(piezod(*arguments, "--json").out)
    out = " ".join(piezod(*arguments).out.split())

    removed = document["test_offset_removed"]
    assert removed["offset_um"] == pytest.approx(0.5, rel=0.2)
    assert removed["voltage_error_rms_pct"] < document["test"]["voltage_error_rms_pct"]
    assert document["with_creep"]["test_offset_removed"] == removed
    assert document["without_creep"]["test_offset_removed"]["offset_um"] != removed["offset_um"]
    assert f"with creep: {removed['offset_pct']:+.2f} %" in out


@pytest.mark.usefixtures("fitted_once")
def test_uncertainty_is_reported(piezod: Command, data: Path) -> None:
    """The uncertainties of delay, creep and voltage are in the document and in the text."""
    document = json.loads(piezod("identify", "--verbose", data, "--creep", "--json").out)
    out = " ".join(piezod("identify", "--verbose", data, "--creep").out.split())

    uncertainty = document["uncertainty"]
    assert 0.0 < uncertainty["delay_95_s"] <= document["delay_estimate"]["uncertainty_s"]
    assert 0.0 < uncertainty["creep_per_decade_95"] < document["creep_per_decade"]
    band = uncertainty["voltage_band_95"]
    assert 0.0 < band["rms_pct"] <= band["max_pct"] < 1.0
    assert 0.0 < uncertainty["voltage_spread_over_blocks"]["rms_pct"] < 1.0
    assert "Uncertainty due to noise (95 %): delay ±" in out
    assert f"predicted voltage ± {band['rms_pct']:.2f} % rms" in out
