"""Tests of the identification from data files."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from piezod.config.model_file import load_model
from piezod.errors import DataError
from piezod.experiment.fit.automatic import Wanted
from piezod.experiment.fit.file import FileFit, identify_file
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.outputs import write_model
from piezod.experiment.fit.settings import FitSettings
from piezod.hysteresis import LEAST_SLOPE
from tests.experiment.made_up import ORDER, RATE_HZ, record_of, sine, swells, write_record

Identify = Callable[..., FileFit]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Return a data file of a made-up stage with a delay of two samples."""
    path = tmp_path / "data.csv"
    write_record(path, record_of(delay_periods=2.0))
    return path


def identify(data: Path, **changed: object) -> FileFit:
    """Identify with least squares and a given delay, except for the changed arguments."""
    settings = {
        "test": None,
        "skip_s": 0.0,
        "delay_s": 2.0 / RATE_HZ,
        "settings": FitSettings(order=ORDER),
    }
    return identify_file(data, **{**settings, **changed})  # type: ignore[arg-type]  # names in a table


def test_first_seconds_do_not_count(data: Path) -> None:
    """Skipped samples advance the memory, but are in no error and in no range."""
    fitted = identify(data, skip_s=1.0)

    assert fitted.record.t_s[0] == 0.0
    assert fitted.record.run_in_s == 1.0
    assert not np.any(fitted.record.counted()[:100])
    assert fitted.chosen.train == fitted.chosen.fit.errors_pct(fitted.record)


def test_other_file_is_judged_by_the_same_model(data: Path, tmp_path: Path) -> None:
    """The errors of the test are those of the model on the other record."""
    other, other_record = tmp_path / "other.csv", record_of(delay_periods=2.0, duration_s=12.0)
    write_record(other, other_record)

    fitted = identify(data, test=other)

    assert fitted.chosen.test == fitted.chosen.fit.errors_pct(other_record)
    assert not any("rest" in warning for warning in fitted.warnings)


def test_fit_has_a_counterpart_with_or_without_creep(data: Path) -> None:
    """All other settings are the same, so that it shows the effect of creep."""
    without, creeping = (
        identify(data, settings=FitSettings(order=ORDER, creep=creep)) for creep in (False, True)
    )

    for fitted, creep in ((without, False), (creeping, True)):
        assert fitted.other
        assert (fitted.chosen.fit.settings.creep, fitted.other.fit.settings.creep) == (
            creep,
            not creep,
        )
        assert fitted.other.fit.settings.order == ORDER
        assert fitted.other.fit.model.delay_s == fitted.chosen.fit.model.delay_s


def test_fit_has_a_counterpart_without_smoothing(tmp_path: Path) -> None:
    """On a noisy record the same fit without smoothing is worse."""
    path = tmp_path / "noisy.csv"
    write_record(path, record_of(path=swells, noise=0.005))

    fitted = identify(path, delay_s=0.0)

    assert fitted.raw
    assert not fitted.raw.fit.settings.smoothing
    assert fitted.raw.validation.rms_pct > fitted.chosen.validation.rms_pct


def test_lms_has_no_counterparts(data: Path) -> None:
    """LMS has neither creep nor smoothing."""
    fitted = identify(data, settings=FitSettings(method=Method.LMS, order=ORDER))

    assert (fitted.other, fitted.raw) == (None, None)
    assert fitted.chosen.validation.rms_pct > 0.0


def test_fixed_settings_are_the_same_in_all_candidates(data: Path) -> None:
    """The candidates differ in the free settings, and the choice is returned."""
    fitted = identify(data, settings=Wanted(order=5, spacing=Spacing.GRADED))

    assert fitted.choice
    tried = [each.fit.settings for each in fitted.choice.candidates]
    assert {(each.order, each.spacing) for each in tried} == {(5, Spacing.GRADED)}
    assert {each.creep for each in tried} == {False, True}
    assert fitted.chosen.fit is fitted.choice.chosen.fit


def test_test_outside_the_range_of_the_model_has_a_warning(data: Path, tmp_path: Path) -> None:
    """Displacements outside the range count as its ends."""
    other, record = tmp_path / "other.csv", record_of(delay_periods=2.0)
    record.position_um[:] += 3.0
    write_record(other, record)

    *_, warning = identify(data, test=other).warnings

    assert "of the test's displacements are outside the range of the model" in warning


def test_one_frequency_has_a_warning(tmp_path: Path) -> None:
    """The warning says how little the record determines the delay."""
    path = tmp_path / "sine.csv"
    write_record(path, record_of(delay_periods=2.0, path=sine))

    assert identify(path).warnings == ()
    (warning,) = identify(path, delay_s=None).warnings

    assert warning.startswith("The drive has one frequency.")
    assert "only to about a sample, 10 ms" in warning


def test_delay_at_the_end_of_the_search_has_a_warning(tmp_path: Path) -> None:
    """The true delay may be longer."""
    path = tmp_path / "late.csv"
    write_record(path, record_of(delay_periods=8.0))

    (warning,) = identify(path, delay_s=None).warnings

    assert warning.startswith("The delay is the longest that was tried, 60 ms")


def test_more_operators_than_noisy_data_determine_still_give_an_inverse(tmp_path: Path) -> None:
    """Weights that only noise determines still have an inverse."""
    path, record = tmp_path / "noisy.csv", record_of(duration_s=10.0)
    record.position_um[:] += np.random.default_rng(1).normal(scale=0.3, size=record.t_s.size)
    write_record(path, record)

    fitted = identify(path, delay_s=0.0, settings=FitSettings(order=60))

    assert fitted.chosen.fit.smallest_slope >= LEAST_SLOPE - 1e-9


def test_refusals_begin_with_the_file(data: Path) -> None:
    """The error starts with the name of the file."""
    with pytest.raises(DataError) as caught:
        identify(data, skip_s=24.9)
    assert str(caught.value).startswith(f"{data}: 10 samples are left for 12 weights")

    with pytest.raises(DataError) as caught:
        identify(data, skip_s=99.0)
    assert str(caught.value) == f"{data}: skipping 99 s leaves nothing of a record of 24.99 s"


def test_model_is_written_with_a_figure_beside_it(data: Path, tmp_path: Path) -> None:
    """The file contains the model, and a PNG has its name."""
    fitted, path = identify(data), tmp_path / "models" / "stage.yaml"

    plot = write_model(path, fitted, datetime(2024, 5, 1, tzinfo=UTC))

    assert load_model(path).fit.model_dump() == fitted.chosen.train
    assert plot == tmp_path / "models" / "stage.png"
    assert plot.read_bytes().startswith(b"\x89PNG")
