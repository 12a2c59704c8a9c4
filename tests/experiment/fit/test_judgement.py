"""Tests of the errors of a fit on another record."""

from dataclasses import replace

import pytest

from piezod.experiment.fit.errors import cross_validate, judge
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.settings import FitSettings
from tests.experiment.made_up import ORDER, record_of, swells

FIT = fit_model(record_of(path=swells), FitSettings(order=ORDER, delay_s=0.0))
RECORD = record_of(path=swells)


def test_without_another_record_there_is_no_test() -> None:
    """The errors on the record and its blocks are there anyway."""
    judged = judge(FIT, RECORD, None)

    assert (judged.test, judged.test_offset_removed) == (None, None)
    assert judged.train == FIT.errors_pct(RECORD)
    assert judged.validation.errors == cross_validate(FIT).errors


def test_known_cross_validation_is_not_repeated() -> None:
    """Cross-validation takes time."""
    known = cross_validate(FIT, blocks=2)

    assert judge(FIT, RECORD, None, known).validation is known


@pytest.mark.parametrize("shift_um", [-0.6, 0.3])
def test_constant_offset_is_found_and_removed(shift_um: float) -> None:
    """A shift of the displacement is reported as the offset; without it the errors are small."""
    shifted = replace(RECORD, position_um=RECORD.position_um + shift_um)

    judged = judge(FIT, RECORD, shifted)

    offset = judged.test_offset_removed
    assert judged.test
    assert offset
    assert offset.offset_um == pytest.approx(shift_um, rel=0.1)
    assert offset.offset_pct * shift_um > 0.0
    assert offset.errors["voltage_error_rms_pct"] < 0.4 * judged.test["voltage_error_rms_pct"]


def test_errors_without_an_offset_are_nearly_the_same() -> None:
    """The residuals on the record of the fit have almost no constant part."""
    judged = judge(FIT, RECORD, RECORD)

    offset = judged.test_offset_removed
    assert judged.test and offset
    assert offset.offset_pct == pytest.approx(0.0, abs=1e-3)
    assert offset.errors == pytest.approx(judged.test, rel=0.05)
