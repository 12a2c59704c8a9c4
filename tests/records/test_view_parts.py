"""What a viewer shows beside the columns of a recording."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from piezod.errors import DataError
from piezod.records import view_parts as module
from piezod.records.recording.writer import TelemetryWriter
from piezod.records.view_parts import contents, loop, marks
from piezod.telemetry.arrays import Records, record_dtype
from piezod.telemetry.record import StageEvent
from tests.records.telemetry import START_NS, header

ROWS = 6000


def cycles() -> Records:
    """Return 6 s of a growing loop at 1 kHz with one late cycle, one skip, and invalid samples."""
    made = np.zeros(ROWS, record_dtype(1))
    number = np.arange(ROWS)
    made["seq"], made["t_ns"] = number, START_NS + number * 1_000_000
    made["late_ns"][1234] = 700_000
    made["skipped"][2000:] = 3
    x = made["axes"][:, 0]
    phase = number / 200
    x["in_force_v"] = number / 100 * np.sin(phase)
    x["position_um"] = number / 500 * np.sin(phase - 0.3)
    x["position_um"][3000:3010] = np.nan
    return made


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return such a recording, with 5 cycles missing before 4 s, and two events."""
    path = tmp_path_factory.mktemp("parts") / "rec.h5"
    made = cycles()
    fault = StageEvent(START_NS + 2_500_000_000, "error", "fault", "sensor jumped", "S3")
    started = StageEvent(START_NS + 100_000_000, "info", "state", "SAFE to READY")
    with TelemetryWriter(path, header(), record_dtype(1)) as writer:
        writer.append_events([started, fault])
        writer.append(made[:4000], 0)
        writer.append(made[4000:], 5)
    return path


def test_contents_has_columns_with_units_and_span(file: Path) -> None:
    """A list of columns has their units and meaning, and the span is that of all rows."""
    found = contents(file)
    columns = {column.name: column for column in found.columns}
    assert (found.axes, found.rows, found.lost, found.rate_hz) == (("x",), ROWS, 5, 1000.0)
    assert found.begin_s == 0.0
    assert found.end_s == pytest.approx(5.999)
    assert columns["axis_x/position_um"].unit == "um"
    assert "axis_x/t_s" not in columns


def test_marks_show_every_kind_at_its_instant(file: Path) -> None:
    """Late and skipped cycles, invalid samples, gaps and events have a mark where they are."""
    found = {mark.kind: mark for mark in marks(file, "x")}
    expected_s = {
        "state": 0.1, "late": 1.234, "skipped": 2.0, "fault": 2.5, "invalid": 3.0, "lost": 4.0
    }  # fmt: skip
    assert found.keys() == expected_s.keys()
    for kind, t_s in expected_s.items():
        assert found[kind].begin_s - 0.02 <= t_s <= found[kind].end_s + 0.02
    assert found["late"].text == "a cycle began 700 µs late"
    assert found["skipped"].text == "periods skipped by the loop: 3"
    assert found["invalid"].text == "invalid samples: 10"
    assert found["lost"].text == "cycles missing in the file: 5"
    assert found["fault"].text == "sensor jumped"


def test_marks_are_those_of_the_span(file: Path) -> None:
    """A span shows nothing of the time before or after it, not even the skips before it."""
    assert [mark.kind for mark in marks(file, "x", 2.1, 2.9)] == ["fault"]


def test_errors_stay_when_there_are_too_many_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of too many events the least severe are left out."""
    monkeypatch.setattr(module, "_MARK_BUCKETS", 3)
    path = tmp_path / "rec.h5"
    severities = ("info", "info", "warning", "info", "error")
    with TelemetryWriter(path, header(), record_dtype(1)) as writer:
        writer.append_events(
            StageEvent(START_NS + number * 1_000_000, severity, severity, "")
            for number, severity in enumerate(severities)
        )
        writer.append(cycles()[:100], 0)
    assert [mark.kind for mark in marks(path, "x")] == ["info", "warning", "error"]


@pytest.mark.parametrize("portion", [64, 2**18])
def test_a_thinned_loop_keeps_its_tips(
    file: Path, monkeypatch: pytest.MonkeyPatch, portion: int
) -> None:
    """The extremes of drive and displacement survive, in pairs of one row, however it is read."""
    monkeypatch.setattr(module, "_READ_ROWS", portion)
    axis = cycles()["axes"][:, 0]
    valid = np.isfinite(axis["position_um"])
    found = loop(file, "x", points=200)
    for name, values in (("in_force_v", found.drive_v), ("position_um", found.position_um)):
        assert values.min() == axis[name][valid].min()
        assert values.max() == axis[name][valid].max()
    rows = np.round(found.t_s * 1000).astype(int)
    assert np.all(np.diff(rows) > 0)
    assert np.array_equal(axis["position_um"][rows], found.position_um)
    assert 50 < rows.size <= 210


def test_a_short_span_of_the_loop_has_all_rows(file: Path) -> None:
    """A part with few rows is not thinned, and has no invalid sample."""
    found = loop(file, "x", 2.9, 3.1, points=4000)
    assert found.t_s.size == 190
    assert np.isfinite(found.position_um).all()


def test_an_empty_span_has_no_loop(file: Path) -> None:
    """A span after the end is empty."""
    assert loop(file, "x", 10.0, 11.0).t_s.size == 0


def test_other_files_and_axes_are_refused(file: Path, tmp_path: Path) -> None:
    """The text names what is wrong."""
    with pytest.raises(DataError, match="no axis 'y'; its axes are x"):
        loop(file, "y")
    with pytest.raises(ValueError, match="4 or more"):
        loop(file, "x", points=1)
    with h5py.File(tmp_path / "other.h5", "w", libver="v110"):
        pass
    with pytest.raises(DataError, match="not the recording of a stage"):
        contents(tmp_path / "other.h5")
