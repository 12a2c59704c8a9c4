"""Tests of the shortening of long records."""

from pathlib import Path

import numpy as np
import pytest

from piezod.experiment.fit.file import identify_file
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.thinning import MAX_SAMPLES, UNAVERAGED_SAMPLES, thinned
from tests.experiment.made_up import write_record


def test_short_record_is_unchanged() -> None:
    """Up to 20 000 samples are not averaged."""
    t_s = np.arange(float(UNAVERAGED_SAMPLES))
    record = Record(t_s, np.sin(0.001 * t_s), np.sin(0.001 * t_s))

    assert np.array_equal(thinned(record).t_s, t_s)


def test_slow_record_is_averaged_to_its_end() -> None:
    """Drive and displacement stay aligned, and the whole time is kept."""
    t_s = 0.001 * np.arange(250_000.0)
    drive_v = 50.0 * (1.0 - np.cos(t_s))

    record = thinned(Record(t_s, drive_v, 0.2 * drive_v))

    assert record.t_s.size <= MAX_SAMPLES
    assert record.t_s[-1] == pytest.approx(t_s[-1], abs=2.0 * record.period_s)
    assert record.position_um == pytest.approx(0.2 * record.drive_v)


def test_dropped_end_has_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive that jumps all the time cannot be averaged; the end of its record is dropped."""
    fewer = UNAVERAGED_SAMPLES + 1000
    for module in ("thinning", "file"):
        monkeypatch.setattr(f"piezod.experiment.fit.{module}.MAX_SAMPLES", fewer)
    t_s = 0.001 * np.arange(fewer + 5000.0)
    levels = np.random.default_rng(1).uniform(0.0, 100.0, t_s.size // 10 + 1)
    drive_v = np.repeat(levels, 10)[: t_s.size]
    write_record(tmp_path / "long.csv", Record(t_s, drive_v, 0.2 * drive_v))

    fitted = identify_file(
        tmp_path / "long.csv",
        test=None,
        skip_s=0.0,
        delay_s=0.0,
        settings=FitSettings(order=3),
    )

    assert fitted.record.t_s.size == fewer
    (warning,) = (each for each in fitted.warnings if "not used" in each)
    assert warning.startswith("The last 5 s of the record are not used: it has 26000 samples")
