"""Long records."""

from pathlib import Path

import numpy as np
import pytest

from piezod.experiment.fit.file import identify_file
from piezod.experiment.fit.fit import FitSettings
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.thinning import ENOUGH, MOST, thinned
from tests.experiment.made_up import write_record


def test_a_short_record_stays_as_it_is() -> None:
    """Up to 20 000 samples none is averaged."""
    t_s = np.arange(float(ENOUGH))
    record = Record(t_s, np.sin(0.001 * t_s), np.sin(0.001 * t_s))

    assert np.array_equal(thinned(record).t_s, t_s)


def test_a_slow_record_is_averaged_to_its_end() -> None:
    """Drive and displacement stay beside each other, and no time is left out."""
    t_s = 0.001 * np.arange(250_000.0)
    drive_v = 50.0 * (1.0 - np.cos(t_s))

    record = thinned(Record(t_s, drive_v, 0.2 * drive_v))

    assert record.t_s.size <= MOST
    assert record.t_s[-1] == pytest.approx(t_s[-1], abs=2.0 * record.period_s)
    assert record.position_um == pytest.approx(0.2 * record.drive_v)


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    """A drive that jumps all the time cannot be averaged; the end is left out, and it is said."""
    t_s = 0.001 * np.arange(MOST + 5000.0)
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

    assert fitted.record.t_s.size == MOST
    (warning,) = (each for each in fitted.warnings if "left out" in each)
    assert warning.startswith("The last 5 s of the record are left out: it has 105000 samples")
