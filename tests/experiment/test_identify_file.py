"""From data files to models."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from piezod.config.model_file import load_model
from piezod.errors import DataError
from piezod.experiment.identify_file import FileFit, identify_file
from piezod.experiment.method import Method
from piezod.experiment.model_outputs import write_model
from tests.experiment.made_up import ORDER, RATE_HZ, record_of, sine, write_record

Identify = Callable[..., FileFit]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Return a data file of a made-up stage that is two samples late."""
    path = tmp_path / "data.csv"
    write_record(path, record_of(delay_periods=2.0))
    return path


def identify(data: Path, **changed: object) -> FileFit:
    """Identify with least squares and a given delay, but for what is changed."""
    settings = {"test": None, "skip_s": 0.0, "delay_s": 2.0 / RATE_HZ, "order": ORDER}
    return identify_file(data, **{"method": Method.LEAST_SQUARES, **settings, **changed})  # type: ignore[arg-type]  # names in a table


def test_first_seconds_are_left_out(data: Path) -> None:
    """What is skipped takes no part in the fit, nor in the errors."""
    fitted = identify(data, skip_s=1.0)

    assert fitted.record.t_s[0] == pytest.approx(1.0)
    assert fitted.train == fitted.fit.model.errors_pct(fitted.record)


def test_other_file_is_judged_by_the_same_model(data: Path, tmp_path: Path) -> None:
    """The test's errors are those of the model on the other record."""
    other, other_record = tmp_path / "other.csv", record_of(delay_periods=2.0, duration_s=12.0)
    write_record(other, other_record)

    fitted = identify(data, test=other)

    assert fitted.test == fitted.fit.model.errors_pct(other_record)
    assert fitted.warnings == ()


def test_test_beyond_the_model_s_range_is_said(data: Path, tmp_path: Path) -> None:
    """Displacements that the model never saw count as the ends of its range."""
    other, record = tmp_path / "other.csv", record_of(delay_periods=2.0)
    record.position_um[:] += 3.0
    write_record(other, record)

    (warning,) = identify(data, test=other).warnings

    assert "of the test's displacements are outside of what the model was fitted to" in warning


def test_one_frequency_is_said(tmp_path: Path) -> None:
    """Whoever asks for the delay of such a record learns how little it tells."""
    path = tmp_path / "sine.csv"
    write_record(path, record_of(delay_periods=2.0, path=sine))

    assert identify(path).warnings == ()
    (warning,) = identify(path, delay_s=None).warnings

    assert warning.startswith("The drive has one frequency.")
    assert "only to about a sample, 10 ms" in warning


def test_delay_at_the_end_of_the_search_is_said(tmp_path: Path) -> None:
    """An estimate at the longest candidate may be no estimate at all."""
    path = tmp_path / "late.csv"
    write_record(path, record_of(delay_periods=8.0))

    (warning,) = identify(path, delay_s=None).warnings

    assert warning.startswith("The delay is the longest that was tried, 60 ms")


def test_inverse_that_is_not_monotone_is_said(tmp_path: Path) -> None:
    """More operators than noisy data determine give an inverse that goes back and forth."""
    path, record = tmp_path / "noisy.csv", record_of()
    record.position_um[:] += np.random.default_rng(1).normal(scale=0.3, size=record.t_s.size)
    write_record(path, record)

    fitted = identify(path, delay_s=0.0, order=100)

    assert fitted.fit.smallest_slope < 0.0
    (warning,) = fitted.warnings
    assert warning.startswith("The inverse is not monotone: its smallest slope is -")


def test_refusals_begin_with_the_file(data: Path) -> None:
    """A person sees which of the files is meant."""
    with pytest.raises(DataError) as caught:
        identify(data, skip_s=24.9)
    assert str(caught.value).startswith(f"{data}: 10 samples are left for 12 weights")

    with pytest.raises(DataError) as caught:
        identify(data, skip_s=99.0)
    assert str(caught.value) == f"{data}: skipping 99 s leaves nothing of a record of 24.99 s"


def test_model_is_written_with_a_figure_beside_it(data: Path, tmp_path: Path) -> None:
    """The file holds the model, the figure is a PNG of its name."""
    fitted, path = identify(data), tmp_path / "models" / "stage.yaml"

    plot = write_model(path, fitted, datetime(2024, 5, 1, tzinfo=UTC))

    assert load_model(path).fit.model_dump() == fitted.train
    assert plot == tmp_path / "models" / "stage.png"
    assert plot.read_bytes().startswith(b"\x89PNG")
