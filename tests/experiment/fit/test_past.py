"""What the past of a record may have changed in it."""

import numpy as np
import pytest

from piezod.experiment.fit.past import with_past
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

T_S = np.arange(2000) / 100.0


def record(drive_v: FloatArray, position_um: FloatArray | None = None) -> Record:
    """Return a record of this drive; the displacement follows it if it is not given."""
    return Record(T_S, drive_v, 0.2 * drive_v if position_um is None else position_um)


def test_a_record_that_begins_at_the_lowest_drive_counts_from_its_first_sample() -> None:
    """A stage rests there."""
    seen = with_past(record(50.0 - 50.0 * np.cos(2 * np.pi * 0.5 * T_S)))

    assert (seen.run_in_s, seen.from_rest) == (0.0, True)


def test_what_the_past_may_have_changed_does_not_count() -> None:
    """That is until the drive was at its top, at 0.5 s, and at its bottom, at 1.5 s."""
    seen = with_past(record(50.0 + 50.0 * np.sin(2 * np.pi * 0.5 * T_S)))

    assert 1.0 < seen.run_in_s <= 1.5
    assert not seen.from_rest


def test_a_drive_that_reaches_its_ends_late_counts_from_its_first_sample() -> None:
    """Most of a record is not given up for a past that may not matter."""
    seen = with_past(record(50.0 + 2.5 * T_S * np.sin(2 * np.pi * 0.5 * T_S)))

    assert seen.run_in_s == 0.0


@pytest.mark.parametrize("jump", [-1.0, 1.0])
def test_a_displacement_that_begins_beyond_its_loops_began_at_rest(jump: float) -> None:
    """There it had been for long, whatever the first voltage is."""
    drive_v = 50.0 + 50.0 * np.sin(2 * np.pi * 0.5 * T_S)
    position_um = 0.2 * drive_v
    position_um[0] = 10.0 + 12.0 * jump

    assert with_past(record(drive_v, position_um)).from_rest
