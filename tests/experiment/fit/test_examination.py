"""Tests of what is found in records before a fit: on records of the rig, with and without defects.

The thresholds were chosen on the rig; the measured records only test them.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.errors import DataError
from piezod.experiment.fit.examination import examined
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.source import read_source
from tests.experiment.fit.rig_records import DRIVES, GRADUAL, VARIANTS, rig_record
from tests.experiment.made_up import record_of
from tests.experiment.made_up_surface import surface_record

gradual = st.builds(rig_record, st.sampled_from(VARIANTS), st.sampled_from(GRADUAL))
"""Records whose drive does not jump."""
places = st.integers(500, 3500)


def moved(record: Record, rows: slice | list[int], by: float) -> Record:
    """Return a record whose displacement is moved in some rows, by a share of its range."""
    position_um = record.position_um.copy()
    position_um[rows] += by * np.ptp(position_um)
    return replace(record, position_um=position_um)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("variant", VARIANTS)
def test_good_record_stays_as_it_is(variant: str, drive: str) -> None:
    """Nothing is left out, refused or asked."""
    record = rig_record(variant, drive)

    found = examined(record)

    assert found.record.position_um is record.position_um
    assert found.notes == found.questions == ()


def test_measured_records_are_accepted(shared_data: Path) -> None:
    """No sample is left out; their volts are those of an amplifier's input, which is asked."""
    for name in ("identification.csv", "test.csv"):
        record = read_source(shared_data / "data" / "ntu_p885" / name, 0.0).record

        found = examined(record)

        assert found.record.t_s.size == record.t_s.size
        assert found.notes == ()
        assert len(found.questions) == 1


@settings(max_examples=25, deadline=None)
@given(gradual)
def test_exchanged_columns_are_refused(record: Record) -> None:
    """The loops run the wrong way round."""
    swapped = replace(record, drive_v=record.position_um, position_um=record.drive_v)

    with pytest.raises(DataError, match=r"wrong way round.* exchanged"):
        examined(swapped)


def test_drive_that_was_recorded_later_is_refused_unless_its_delay_is_known() -> None:
    """It looks the same as exchanged columns, until the negative delay is given."""
    record = surface_record(delay_s=-0.04)

    with pytest.raises(DataError, match="recorded later than"):
        examined(record)
    assert examined(record, -0.04).questions == ()


@settings(max_examples=25, deadline=None)
@given(gradual)
def test_inverted_sensor_is_refused(record: Record) -> None:
    """The error names the option that turns it."""
    with pytest.raises(DataError, match="--invert position"):
        examined(replace(record, position_um=-record.position_um))


def test_sensor_of_another_stage_is_refused() -> None:
    """It does not follow the drive, in neither direction."""
    record = record_of(duration_s=5.0)
    noise = np.random.default_rng(2).normal(size=record.t_s.size)

    with pytest.raises(DataError, match="the sensor of this drive"):
        examined(replace(record, position_um=noise - 0.01 * record.position_um))


@settings(max_examples=25, deadline=None)
@given(gradual, st.lists(places, min_size=1, max_size=8, unique=True), st.sampled_from((-1.0, 1.0)))
def test_outliers_are_named_and_left_out(record: Record, rows: list[int], sign: float) -> None:
    """Each is replaced by a straight line, and no other sample changes."""
    rows = [row for row in rows if all(abs(row - other) > 30 for other in rows if other != row)]
    if not rows:
        return

    found = examined(moved(record, rows, 0.3 * sign))

    error_um = np.abs(found.record.position_um - record.position_um)
    assert np.max(error_um) < 0.02 * np.ptp(record.position_um)
    (note,) = found.notes
    assert f"(sample {min(rows) + 1})" in note
    assert note.startswith(f"{len(rows)} × outlier")


@settings(max_examples=25, deadline=None)
@given(gradual, st.integers(3000, 3500), st.sampled_from((-0.03, 0.03)))
def test_jump_ends_the_part_that_is_used(record: Record, row: int, by: float) -> None:
    """A late jump leaves the part before it; time and row are told."""
    found = examined(moved(record, slice(row, None), by))

    assert found.record.t_s[-1] == record.t_s[row - 1]
    (note,) = found.notes
    assert f"(sample {row + 1})" in note


def test_many_jumps_are_refused() -> None:
    """No part without one is long enough."""
    record = rig_record("stack", "sine")
    for row in range(400, 4000, 400):
        record = moved(record, slice(row, None), 0.03)

    with pytest.raises(DataError, match=r"9 × jump.*longest part"):
        examined(record)


@settings(max_examples=25, deadline=None)
@given(gradual, st.sampled_from((0.0, 0.2)), st.sampled_from((0.0, 2e-4, 5e-4)))
def test_clipped_sensor_is_refused(record: Record, low: float, noise: float) -> None:
    """At either end of its range, with and without noise."""
    x = record.position_um
    ends = x.min() + np.array([low, low + 0.8]) * np.ptp(x)
    added = np.random.default_rng(1).normal(0.0, noise * np.ptp(x), x.size)

    with pytest.raises(DataError, match="clipped at the end of its range"):
        examined(replace(record, position_um=np.clip(x, *ends) + added))


@pytest.mark.parametrize("digits", [0, 1, 3])
def test_coarse_sensor_is_not_clipped(digits: int) -> None:
    """At a turn a coarse sensor shows the same value for some time."""
    record = record_of()

    found = examined(replace(record, position_um=np.round(record.position_um, digits)))

    assert found.notes == ()


def test_stuck_sensor_is_left_out() -> None:
    """The part after it is used."""
    record = rig_record("stack", "sine")
    position_um = record.position_um.copy()
    position_um[800:1000] = position_um[800]

    found = examined(replace(record, position_um=position_um))

    assert found.record.t_s[0] == record.t_s[1000]
    assert "stuck" in found.notes[0]


@pytest.mark.parametrize(
    ("changes", "question"),
    [
        ({"t_s": 20.0}, "is it in ms?"),
        ({"drive_v": 1000.0}, "is it in mV?"),
        ({"drive_v": 0.05}, "the monitor of an amplifier"),
        ({"drive_v": 0.001}, "is it in kV"),
        ({"position_um": 1000.0}, "is it in nm?"),
        ({"position_um": 0.001}, "is it in mm"),
    ],
)
def test_units_are_asked(changes: dict[str, float], question: str) -> None:
    """A column that is probably in another unit gives a question; usual columns give none."""
    record = record_of()
    other = {name: getattr(record, name) * factor for name, factor in changes.items()}

    assert examined(record).questions == ()
    (asked,) = examined(replace(record, **other)).questions
    assert question in asked


def test_time_in_milliseconds_is_refused() -> None:
    """No identification lasts for hours: the error names the option that scales it."""
    record = record_of()

    with pytest.raises(DataError, match="is it in ms"):
        examined(replace(record, t_s=1000.0 * record.t_s))
