"""Tests of the table that compares methods by others with those of piezod."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers import __main__ as peers
from benchmarks.peers import libraries
from benchmarks.peers.method import Row, Series
from benchmarks.peers.records import Absent, Case
from benchmarks.peers.table import better_than_piezod, sorted_rows, table_of
from tests.experiment.made_up import record_of

OURS = Row("piezod auto", "order 8", 1.0, 0.2, 2.0, 0.4, 0.1, 0.05)
WORSE_OURS = Row("piezod lms", "order 8", 0.5, 0.5, 1.0, 0.3, 0.1, 0.05)
SMOOTHER = Row("smoother", "k 2", 2.0, 0.19, 1.79, 0.41, 0.1, 0.05)
ABSENT = Row("absent", failure="the library is missing")


def test_rows_are_sorted_by_rms() -> None:
    """The smallest rms error on held-out data comes first, a method that failed last."""
    rows = sorted_rows([ABSENT, WORSE_OURS, OURS, SMOOTHER])

    assert rows == [SMOOTHER, OURS, WORSE_OURS, ABSENT]


def test_a_row_more_than_ten_percent_better_is_marked() -> None:
    """It is compared with the row of piezod that has the smallest rms error."""
    rows = [OURS, WORSE_OURS, SMOOTHER, ABSENT]

    assert better_than_piezod(SMOOTHER, rows) == ("test max",)
    assert [better_than_piezod(row, rows) for row in (OURS, WORSE_OURS, ABSENT)] == [()] * 3
    assert better_than_piezod(SMOOTHER, [SMOOTHER]) == ()


def test_the_table_has_errors_marks_and_reasons() -> None:
    """Each row shows its errors and settings, or why it has none."""
    lines = table_of([ABSENT, OURS, SMOOTHER]).splitlines()

    assert " ".join(lines[1].split()) == (
        "smoother 2.000 0.190 1.790 0.410 0.10 0.05 k 2 <- better than piezod (test max)"
    )
    assert "<-" not in lines[2]
    assert lines[3].split(maxsplit=1) == ["absent", "not measured: the library is missing"]


def test_an_error_without_bound_is_called_divergence() -> None:
    """An error of 1000 % and more has no digits; an error that was not measured is a dash."""
    line = table_of([Row("free run", "", np.inf, 1e4, np.nan, np.nan, 0.1, 0.1)]).splitlines()[1]

    assert line.split()[2:6] == ["diverges", "diverges", "-", "-"]


def test_a_row_survives_json() -> None:
    """A row and its document are the same, NaN included."""
    row = Row("absent", failure="the library is missing")

    again = Row.from_document(row.document())

    assert again.document() == row.document()
    assert np.isnan(again.fit_s)


def test_a_missing_environment_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without `make bench-peers` the row of a library states what to do."""
    monkeypatch.setattr(libraries, "PYTHON", tmp_path / "python")
    series = Series(np.zeros(5), np.zeros(5), np.ones(5, np.bool_))

    row = libraries.row_of_library("NARX", series, series, without_offset=False)

    assert "run `make bench-peers`" in row.failure


def absent() -> Case:
    """Report a record that is not here."""
    raise Absent("the folder is missing")


def short() -> Case:
    """Return a record that is too short for a fit."""
    return Case("too short", record_of(duration_s=0.5), record_of(duration_s=0.5), 0.0, False)


def test_what_cannot_be_measured_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The output and the JSON have the reasons for a skipped record and for a refused fit."""
    monkeypatch.setattr(peers, "CASES", {"absent": absent, "short": short})
    path = tmp_path / "table.json"
    monkeypatch.setattr("sys.argv", ["peers", "--method", "piezod", "--json", str(path)])

    peers.main()

    printed, document = capsys.readouterr().out, json.loads(path.read_text(encoding="utf-8"))
    assert "absent: skipped, the folder is missing" in printed
    assert "not measured: 50 samples are too few" in printed
    assert document["absent"] == {"skipped": "the folder is missing"}
    assert "too few" in document["short"]["rows"][0]["failure"]


def test_an_unknown_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message lists the names, before anything is measured."""
    monkeypatch.setattr("sys.argv", ["peers", "--method", "Preisach"])

    with pytest.raises(SystemExit, match="no method is called Preisach; there are piezod, "):
        peers.main()
