"""What a viewer gets of a column: extremes per bucket, and no sample is hidden."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.errors import DataError
from piezod.records import view as module
from piezod.records.recording.reader import RecordedTelemetry, read_telemetry
from piezod.records.recording.writer import TelemetryWriter
from piezod.records.view import MinMax, RecordingView, view
from tests.records.telemetry import header, record_dtype, records

POSITION = "axis_x/position_um"


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of 7 s with a gap of 1 s, invalid samples, and noise."""
    path = tmp_path_factory.mktemp("view") / "rec.h5"
    random = np.random.default_rng(1)
    with TelemetryWriter(path, header(), record_dtype()) as writer:
        for begin in (0, 2000, 5000):
            portion = records(begin, begin + 2000)
            positions_um = random.normal(size=2000)
            positions_um[random.random(2000) < 0.1] = np.nan
            positions_um[500:900] = np.nan
            portion["axes"][:, 0]["position_um"] = positions_um
            writer.append(portion, 1000 if begin == 5000 else 0)
    return path


@pytest.fixture(scope="module")
def telemetry(file: Path) -> RecordedTelemetry:
    """Return all of it."""
    return read_telemetry(file)


def inside(telemetry: RecordedTelemetry, found: MinMax, at: int) -> NDArray[np.bool_]:
    """Return which rows are in a bucket."""
    t_s = telemetry.cycles["t_s"]
    within: NDArray[np.bool_] = (t_s >= found.begin_s[at]) & (t_s <= found.end_s[at])
    return within


@given(begin=st.integers(-500, 8000), length=st.integers(0, 8000), points=st.integers(1, 400))
def test_buckets_have_the_extremes_of_their_rows(
    file: Path, telemetry: RecordedTelemetry, begin: int, length: int, points: int
) -> None:
    """For any span each row is in one bucket, and each bucket has the extremes of its rows."""
    begin_s, end_s = begin / 1000, (begin + length) / 1000
    found = view(file, POSITION, begin_s, end_s, points)
    t_s, values = telemetry.cycles["t_s"], telemetry.axes["x"]["position_um"]
    span = (t_s >= begin_s) & (t_s < end_s)

    assert len(found.rows) <= points
    assert found.rows.sum() == span.sum()
    assert found.valid.sum() == np.isfinite(values[span]).sum()
    for at in range(len(found.rows)):
        bucket = inside(telemetry, found, at)
        assert bucket.sum() == found.rows[at]
        valid = values[bucket][np.isfinite(values[bucket])]
        extremes = (valid.min(), valid.max()) if valid.size else (np.nan, np.nan)
        np.testing.assert_array_equal((found.minimum[at], found.maximum[at]), extremes)


@given(at=st.integers(0, 2499), points=st.integers(1, 60))
def test_spike_of_one_sample_shows(
    tmp_path_factory: pytest.TempPathFactory, at: int, points: int
) -> None:
    """A single extreme sample is in the view of the whole, wherever it is."""
    path = tmp_path_factory.mktemp("spike") / "rec.h5"
    portion = records(0, 2500)
    portion["axes"][:, 0]["position_um"][at] = 1e9
    with TelemetryWriter(path, header(), record_dtype()) as writer:
        writer.append(portion)
    found = view(path, POSITION, points=points)
    (place,) = np.flatnonzero(found.maximum == 1e9)

    assert found.begin_s[place] <= at / 1000 <= found.end_s[place]


def test_growing_file_is_seen_as_it_grows(tmp_path: Path) -> None:
    """The same file shows what was written meanwhile; what is known about it is not read again."""
    path = tmp_path / "rec.h5"
    with TelemetryWriter(path, header(), record_dtype()) as writer:
        empty = view(path, POSITION, points=10)
        lengths = []
        for begin in range(0, 9000, 1500):
            writer.append(records(begin, begin + 1500))
            found = view(path, POSITION, points=10)
            lengths.append(int(found.rows.sum()))
            assert found.maximum[-1] == (lengths[-1] - 1) / 7
    closed = view(path, POSITION, points=10)

    assert empty.rows.size == 0
    assert lengths == [1000, 3000, 4000, 6000, 7000, 9000]
    assert closed.rows.sum() == 9000


def test_gap_is_no_bucket(file: Path) -> None:
    """No bucket lies within the second that the recording lacks."""
    found = view(file, "cycles/seq", points=70)

    assert not ((found.begin_s > 4.1) & (found.end_s < 4.9)).any()
    assert len(found.rows) < 70


def test_columns_of_numbers_keep_their_type(file: Path) -> None:
    """Instants in ns are exact, and states and yes or no are numbers."""
    t_ns, state, on_target = (
        view(file, name, points=3) for name in ("cycles/t_ns", "cycles/state", "axis_x/on_target")
    )

    assert int(t_ns.minimum[0]) == 5_000_000_000
    assert int(t_ns.maximum[-1]) == 5_000_000_000 + 6999 * 1_000_000
    assert (state.minimum.tolist(), state.maximum.tolist()) == ([0] * 3, [1] * 3)
    assert on_target.maximum.tolist() == [0] * 3


def test_long_file_has_longer_blocks(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The memory of a column is bounded; the extremes stay those of the data."""
    monkeypatch.setattr(module, "_MAX_BLOCKS", 50)
    opened = RecordingView(file)
    found, exact = opened.view("cycles/seq", points=4), view(file, "cycles/seq", points=4)
    opened.close()

    assert (found.minimum.min(), found.maximum.max()) == (0, 6999)
    assert found.rows.sum() == exact.rows.sum() == 6000


def test_new_file_of_the_same_name_is_opened(tmp_path: Path) -> None:
    """A file that replaces another one is not taken for it."""
    path = tmp_path / "rec.h5"
    for end in (100, 200):
        path.unlink(missing_ok=True)
        with TelemetryWriter(path, header(), record_dtype()) as writer:
            writer.append(records(0, end))

        assert view(path, POSITION).rows.sum() == end


@pytest.mark.parametrize("column", ["axis_y/position_um", "gaps", "cycles", "title", ""])
def test_unknown_column_is_refused(file: Path, column: str) -> None:
    """The message names the column and shows how columns are named."""
    with pytest.raises(DataError, match=r"no column .* allowed are such as 'axis_x/position_um'"):
        view(file, column)


def test_wrong_arguments_are_refused(file: Path, tmp_path: Path) -> None:
    """No bucket at all, and a file of another kind, are refused."""
    with h5py.File(tmp_path / "other.h5", "w") as root:
        root["a"] = 1

    with pytest.raises(ValueError, match="1 or more"):
        view(file, POSITION, points=0)
    with pytest.raises(DataError, match="not the recording of a stage"):
        view(tmp_path / "other.h5", POSITION)
