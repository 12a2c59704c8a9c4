"""`piezod identify`."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from piezod.cli.identify.dynamics_view import narrowed
from piezod.config.model_file import load_model
from tests.cli.conftest import Command
from tests.experiment.made_up import record_of, write_record

EVEN = ("--thresholds", "even")
"""The spacing of the made-up stage."""
LEAST_SQUARES = ("--method", "least-squares")


@pytest.fixture
def data(folder: Path) -> Path:
    """Return a data file of a made-up stage with a delay of two samples, 20 ms."""
    write_record(folder / "data.csv", record_of(delay_periods=2.0))
    return Path("data.csv")


def test_document(piezod: Command, data: Path) -> None:
    """With --json, stdout has one document, and stderr nothing."""
    code, out, err = piezod(
        "identify", "--verbose", data, *EVEN, "--delay-s", "auto", "--order", 6, "--json"
    )

    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["data"] == "data.csv"
    assert document["samples"] == 2500
    assert document["rate_hz"] == pytest.approx(100.0)
    assert (document["method"], document["order"]) == ("least-squares", 6)
    assert document["delay_s"] == pytest.approx(0.02, abs=0.001)
    assert document["delay_estimate"]["delay_s"] == document["delay_s"]
    assert document["delay_estimate"]["one_frequency"] is False
    assert set(document["train"]) == {
        "voltage_error_max_pct",
        "voltage_error_rms_pct",
        "position_error_max_pct",
        "position_error_rms_pct",
    }
    assert 0.0 < document["train"]["voltage_error_max_pct"] < 0.1
    assert document["test"] is None
    assert document["smallest_slope"] == pytest.approx(0.71, abs=0.01)
    assert (document["model"], document["plot"]) == (None, None)


def test_document_holds_the_whole_curve(piezod: Command, data: Path) -> None:
    """The criterion in the document is smallest at the delay."""
    document = json.loads(piezod("identify", "--verbose", data, *LEAST_SQUARES, "--json").out)

    curve = document["delay_estimate"]["criterion"]
    assert len(curve["delay_s"]) == len(curve["voltage_error_rms_pct"]) == 61
    least = curve["voltage_error_rms_pct"].index(min(curve["voltage_error_rms_pct"]))
    assert curve["delay_s"][least] == pytest.approx(0.02)


def test_text(piezod: Command, data: Path) -> None:
    """The text has the record, the delay with its curve, the errors, and the next step."""
    code, out, err = piezod(
        "identify", "--verbose", data, *EVEN, "--delay-s", "auto", "--order", 6, "--test", data
    )

    assert (code, err) == (0, "")
    assert "data.csv: 2500 samples at 100 Hz, 24.99 s" in out
    assert "Delay 20 ms, from the smallest rms error" in out
    (curve,) = [line for line in out.splitlines() if line.endswith("█ 60 ms")]
    assert curve.startswith("  0 ms ")
    assert len(curve) < 80
    assert "Model by least-squares, 6 operators on each side, thresholds even." in out
    assert "--out MODEL.yaml writes the model" in out


def test_delay_is_estimated_unless_given(piezod: Command, data: Path) -> None:
    """Without --delay-s the delay is estimated; a given delay is used, also 0."""
    estimated = json.loads(piezod("identify", "--verbose", data, *LEAST_SQUARES, "--json").out)
    none = json.loads(
        piezod("identify", "--verbose", data, *LEAST_SQUARES, "--delay-s", "0", "--json").out
    )

    assert estimated["delay_s"] == estimated["delay_estimate"]["delay_s"]
    assert estimated["delay_s"] == pytest.approx(0.02, abs=0.001)
    assert (none["delay_s"], none["delay_estimate"]) == (0.0, None)
    assert (
        "Delay 20 ms, as given."
        in piezod("identify", "--verbose", data, "--order", 6, "--delay-s", "0.02").out
    )


def test_record_that_does_not_start_from_rest(piezod: Command, folder: Path) -> None:
    """A large error only in the first seconds gives a warning with a remedy."""
    record = record_of()
    drive_v = record.drive_v.copy()
    drive_v[30:50] += 20.0
    write_record(folder / "data.csv", replace(record, drive_v=drive_v))

    document = json.loads(
        piezod("identify", "--verbose", "data.csv", "--delay-s", 0, "--order", 19, "--json").out
    )

    (warning,) = document["warnings"]
    assert warning.startswith("The worst error is at t = 0.")
    assert "seems not to start from rest; leave out the first loops with --skip-s" in warning


def test_one_operator_is_one(piezod: Command, data: Path) -> None:
    """One operator is written in the singular."""
    out = piezod("identify", "--verbose", data, "--order", 1).out

    assert "1 operator on each side, thresholds graded." in out


def test_method_and_order(piezod: Command, data: Path) -> None:
    """`--method lms` selects the paper's method."""
    out = piezod("identify", "--verbose", data, "--method", "lms", "--order", "6", "--json").out

    document = json.loads(out)
    assert (document["method"], document["order"]) == ("lms", 6)


def test_surface(piezod: Command, data: Path, folder: Path) -> None:
    """A surface is fitted without operators, and written as such."""
    code, out, _ = piezod(
        "identify", "--verbose", data, "--method", "surface", "--out", "surface.yaml"
    )
    refused = piezod("identify", "--verbose", data, "--method", "surface", "--order", 3)
    text = (folder / "surface.yaml").read_text(encoding="utf-8")

    assert code == 0
    assert "Model by surface, a smooth surface of loops, with creep." in " ".join(out.split())
    assert "\nversion: 3\n" in text
    assert "surface_coefficients:" in text
    assert refused.code == 2
    assert "a surface has no operators" in refused.err


def test_out_writes_model_and_figure(piezod: Command, data: Path, folder: Path) -> None:
    """The model file has the printed errors, and `check` accepts it."""
    arguments = ("--delay-s", 0.02, "--order", 19, "--out", "new/stage.yaml")

    document = json.loads(piezod("identify", "--verbose", data, *arguments, "--json").out)

    assert (document["model"], document["plot"]) == ("new/stage.yaml", "new/stage.png")
    assert sorted(each.name for each in (folder / "new").iterdir()) == ["stage.png", "stage.yaml"]
    assert load_model(folder / "new/stage.yaml").fit.model_dump() == document["train"]
    out = "new/stage.yaml: ok, a model: 19 operators on each side, by least-squares\n"
    assert piezod("check", "new/stage.yaml") == (0, out, "")


def test_signs_of_mathematics_in_a_file_name(piezod: Command, data: Path, folder: Path) -> None:
    """A file name that looks like a formula of matplotlib is plain text; the files are named."""
    odd = (folder / data).rename(folder / "c_dollar$\\frac$.csv")

    code, out, err = piezod(
        "identify", "--verbose", odd.name, "--order", 6, "--out", "new/stage.yaml"
    )

    assert (code, err) == (0, "")
    assert "Model: new/stage.yaml\nFigure: new/stage.png\n" in out
    assert (folder / "new/stage.png").read_bytes().startswith(b"\x89PNG")


def test_nothing_is_written_without_out(piezod: Command, data: Path, folder: Path) -> None:
    """Without --out no file is written."""
    assert piezod("identify", "--verbose", data, "--order", 6).code == 0

    assert [each.name for each in folder.iterdir()] == ["data.csv"]


def test_folder_that_cannot_be_written_to(
    piezod: Command, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder without write permission is refused before the fit."""

    def refuse(**_: object) -> None:
        raise OSError(30, "Read-only file system", "tmp0123")

    monkeypatch.setattr("piezod.cli.paths.tempfile", SimpleNamespace(TemporaryFile=refuse))
    monkeypatch.setattr("piezod.cli.identify.run.identify_file", None)

    expected = (1, "", ".: cannot be written to: Read-only file system\n")
    assert piezod("identify", "--verbose", data, "--out", "model.yaml") == expected


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--delay-s", "soon"), "'--delay-s': must be auto, or a time from 0 to 1 s (got soon)"),
        (("--delay-s", "-1"), "'--delay-s': must be auto, or a time from 0 to 1 s (got -1)"),
        (("--delay-s", "nan"), "'--delay-s': must be auto, or a time from 0 to 1 s (got nan)"),
        (("--out", "data.csv"), "'--out': must end in .yaml (got data.csv)"),
        (("--order", "0"), "'--order'"),
        (("--order", "201"), "'--order'"),
        (("--skip-s", "-1"), "'--skip-s'"),
        (("--skip-s", "nan"), "'--skip-s'"),
        (("--method", "rls"), "'--method'"),
    ],
)
def test_wrong_options(
    piezod: Command, data: Path, folder: Path, arguments: tuple[str, str], text: str
) -> None:
    """An invalid option is wrong usage, and the data file stays unchanged."""
    before = (folder / data).read_bytes()

    code, out, err = piezod("identify", "--verbose", data, *arguments)

    assert (code, out) == (2, "")
    assert text in err
    assert (folder / data).read_bytes() == before


Lines = list[str]


def with_gap(lines: Lines) -> Lines:
    """Return a record without ten of its samples."""
    return lines[:500] + lines[510:]


def with_infinity(lines: Lines) -> Lines:
    """Return a record with an infinity."""
    t_s, drive_v, _ = lines[700].split(",")
    return [*lines[:700], f"{t_s},{drive_v},inf", *lines[701:]]


def with_text(lines: Lines) -> Lines:
    """Return a record with a word in place of a number."""
    t_s, _, position_um = lines[700].split(",")
    return [*lines[:700], f"{t_s},high,{position_um}", *lines[701:]]


def constant(lines: Lines) -> Lines:
    """Return a record of a sensor that is stuck."""
    return [lines[0], *(",".join([*line.split(",")[:2], "1.5"]) for line in lines[1:])]


def too_short(lines: Lines) -> Lines:
    """Return the first few samples."""
    return lines[:50]


def too_short_for_the_model(lines: Lines) -> Lines:
    """Return enough samples for a file, but not for 38 weights."""
    return lines[:151]


def unsorted(lines: Lines) -> Lines:
    """Return a record with two samples swapped."""
    return [*lines[:300], lines[301], lines[300], *lines[302:]]


def other_columns(lines: Lines) -> Lines:
    """Return a record with other column names."""
    return ["time,voltage,position", *lines[1:]]


def inverted(lines: Lines) -> Lines:
    """Return a record of a sensor with the wrong sign."""
    rows = [line.split(",") for line in lines[1:]]
    return [lines[0], *(f"{t_s},{drive_v},{-float(x)}" for t_s, drive_v, x in rows)]


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (with_gap, "data.csv:501: a gap of 0.11 s before t_s 5.09; allowed are 0.065 s"),
        (with_infinity, "data.csv:701: position_um is inf; allowed is any finite number"),
        (with_text, "data.csv:701: drive_v is 'high'; allowed is a number such as -1.25e-3"),
        (constant, "data.csv:2: position_um is 1.5 in all 2500 samples; allowed is a signal"),
        (too_short, "data.csv:50: the file ends after 49 samples; allowed are 100 or more"),
        (too_short_for_the_model, "data.csv: 150 samples are left for 38 weights; allowed are 190"),
        (unsorted, "data.csv:302: t_s 2.99 comes after 3.0; allowed is time that rises"),
        (other_columns, "data.csv: which column is the time? No column has a name and a unit"),
        (inverted, "data.csv: position_um does not grow with the drive: its correlation with"),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_bad_data(
    piezod: Command, data: Path, folder: Path, spoil: Callable[[Lines], Lines], text: str
) -> None:
    """A problem of a file is reported with its line; nothing is on stdout."""
    path = folder / data
    lines = spoil(path.read_text(encoding="utf-8").splitlines())
    path.write_text("\n".join(lines), encoding="utf-8")

    options = (*LEAST_SQUARES, "--out", "model.yaml", "--json")
    code, out, err = piezod("identify", "--verbose", data, *options)

    assert (code, out) == (1, "")
    assert err.startswith(text)
    assert err.count("\n") == 1
    assert [each.name for each in folder.iterdir()] == ["data.csv"]


def test_bad_test_data(piezod: Command, data: Path, folder: Path) -> None:
    """The test record is checked likewise, and the error names it."""
    (folder / "other.csv").write_text("t_s\n", encoding="utf-8")

    code, out, err = piezod("identify", "--verbose", data, "--test", "other.csv")

    assert (code, out) == (1, "")
    assert err.startswith("other.csv:1: there are no rows of numbers")


def test_measured_stage(piezod: Command, shared_data: Path) -> None:
    """The voltage of a measured stage is predicted to 1.6 %, with warnings on delay and drift."""
    folder = shared_data / "data" / "ntu_p885"
    files = (folder / "identification.csv", "--test", folder / "test.csv")

    code, out, err = piezod(
        "identify", "--verbose", *files, "--skip-s", 1, "--method", "least-squares", "--json"
    )

    assert (code, err) == (0, "")
    document = json.loads(out)
    assert 0.004 < document["delay_s"] < 0.011
    assert document["train"]["voltage_error_max_pct"] < 1.6
    assert document["train"]["voltage_error_rms_pct"] < 0.35
    assert document["test"]["voltage_error_max_pct"] < 6.0
    assert document["delay_estimate"]["one_frequency"] is True
    on_delay, on_drift = document["warnings"]
    assert "determines the delay only to about a sample, 5 ms" in on_delay
    assert "The return points drift by 1.4 % of the range over the record" in on_drift
    assert document["position_residual"]["return_point_drift_pct"] == pytest.approx(1.36, abs=0.1)


def test_curve_of_a_long_search_fits_on_a_line() -> None:
    """Neighbouring delays share a bar, which has the smallest of their errors."""
    errors_pct = np.abs(np.arange(201.0) - 130.0)
    curve_pct = narrowed(errors_pct)

    assert curve_pct.size == 61
    assert curve_pct.min() == 0.0
    assert narrowed(errors_pct[:40]).tolist() == errors_pct[:40].tolist()
