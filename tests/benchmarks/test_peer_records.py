"""Tests of the records on which methods are compared, and of the rows of piezod."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers import records
from benchmarks.peers.ours import rows_of_piezod
from benchmarks.peers.records import CASES, Absent, Case
from benchmarks.peers.simulated import experiments
from piezod.experiment.fit.automatic import Wanted, choose
from piezod.plant.variants import VARIANTS
from tests.experiment.made_up import record_of


def case_of(*, without_offset: bool = False) -> Case:
    """Return a short record as a case; the test is another record of the same stage."""
    return Case("made up", record_of(duration_s=6.0), record_of(), 0.02, without_offset)


def test_every_variant_has_a_record() -> None:
    """A variant that is added to the rig is compared, too."""
    assert set(VARIANTS) < set(CASES)


@pytest.mark.parametrize("variant", VARIANTS)
def test_drives_of_a_variant_use_its_full_travel(variant: str) -> None:
    """Record and test are different drives of one specimen, up to the voltage of its travel."""
    identification, test = experiments(variant)

    assert identification.devices == test.devices
    assert identification.axes["x"].limits.drive_max_v == VARIANTS[variant].parameters.stage.drive_v
    assert identification.identification != test.identification
    for each in (identification.identification, test.identification):
        assert each is not None
        drive = each.drive_v.built(each.duration_s)
        assert drive.low == pytest.approx(VARIANTS[variant].lowest_v)


def test_an_absent_record_is_skipped_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reason names the folder and the variable that sets it."""
    monkeypatch.setattr(records, "SHARED", tmp_path)

    with pytest.raises(Absent, match=r"ntu_p885 is not a folder \(set PIEZOD_SHARED_DATA\)"):
        records.measured()


def test_all_methods_get_one_range_and_no_delay() -> None:
    """The record of the fit fills [0, 1], and the drive is the one before the delay."""
    case = case_of()

    record, test = case.series()

    assert (record.positions.min(), record.positions.max()) == pytest.approx((0.0, 1.0))
    assert test.positions.size == case.test.t_s.size
    delayed_v = case.record.drive_delayed_by(0.02)
    low_v, high_v = case.record.drive_v.min(), case.record.drive_v.max()
    assert record.drives == pytest.approx((delayed_v - low_v) / (high_v - low_v))


@pytest.fixture
def one_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let piezod try models of one size only, which takes less time."""
    monkeypatch.setattr("piezod.experiment.fit.automatic.ORDERS", (5,))


@pytest.mark.usefixtures("one_order")
def test_piezod_has_a_row_for_each_kind_of_model() -> None:
    """Its choice comes first; the errors are those of its own cross-validation."""
    case = case_of()
    choice = choose(case.record, Wanted(), case.delay_s)

    rows = rows_of_piezod(case)

    kinds = {replace(candidate.fit.settings, order=0) for candidate in choice.candidates}
    assert len(rows) == 1 + len(kinds)
    assert all(row.method.startswith("piezod ") for row in rows)
    assert rows[0].method == "piezod auto"
    assert rows[0].held_out_rms_pct == choice.chosen.validation.rms_pct
    assert min(row.held_out_rms_pct for row in rows) == choice.best.validation.rms_pct
    test_pct = choice.chosen.fit.errors_pct(case.test)
    assert rows[0].test_rms_pct == pytest.approx(test_pct["voltage_error_rms_pct"])
    assert np.isfinite([row.fit_s for row in rows]).all()


@pytest.mark.usefixtures("one_order")
def test_a_constant_offset_is_removed_from_the_test_if_requested() -> None:
    """The rms error without its mean is the standard deviation."""
    kept, removed = (rows_of_piezod(case_of(without_offset=each))[0] for each in (False, True))

    assert removed.test_rms_pct < kept.test_rms_pct
