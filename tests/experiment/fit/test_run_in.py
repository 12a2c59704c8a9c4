"""Tests of records whose past is unknown."""

import numpy as np
import pytest

from piezod.experiment.fit.record import Record
from piezod.experiment.fit.run_in import mark_unknown_past
from piezod.hysteresis.memory import FloatArray

T_S = np.arange(2000) / 100.0


def record(drive_v: FloatArray, position_um: FloatArray | None = None) -> Record:
    """Return a record of this drive; the displacement follows it if it is not given."""
    return Record(T_S, drive_v, 0.2 * drive_v if position_um is None else position_um)


def test_record_that_starts_at_the_lowest_drive_counts_completely() -> None:
    """A stage rests there."""
    marked = mark_unknown_past(record(50.0 - 50.0 * np.cos(2 * np.pi * 0.5 * T_S)))

    assert (marked.run_in_s, marked.from_rest) == (0.0, True)


def test_samples_with_an_unknown_past_do_not_count() -> None:
    """The past is known after the top of the drive, at 0.5 s, and its bottom, at 1.5 s."""
    marked = mark_unknown_past(record(50.0 + 50.0 * np.sin(2 * np.pi * 0.5 * T_S)))

    assert 1.0 < marked.run_in_s <= 1.5
    assert not marked.from_rest


def test_record_whose_drive_reaches_its_ends_late_counts_completely() -> None:
    """Not most of a record is dropped for a past that may not matter."""
    marked = mark_unknown_past(record(50.0 + 2.5 * T_S * np.sin(2 * np.pi * 0.5 * T_S)))

    assert marked.run_in_s == 0.0


@pytest.mark.parametrize("jump", [-1.0, 1.0])
def test_displacement_that_starts_beyond_its_loops_starts_from_rest(jump: float) -> None:
    """The first voltage does not matter."""
    drive_v = 50.0 + 50.0 * np.sin(2 * np.pi * 0.5 * T_S)
    position_um = 0.2 * drive_v
    position_um[0] = 10.0 + 12.0 * jump

    assert mark_unknown_past(record(drive_v, position_um)).from_rest
