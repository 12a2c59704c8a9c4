"""How a fit is judged on another record."""

from dataclasses import replace

import pytest

from piezod.experiment.fit.cross_validation import cross_validate
from piezod.experiment.fit.fit import FitSettings, fit_model
from piezod.experiment.fit.judgement import judge
from tests.experiment.made_up import ORDER, record_of, swells

FIT = fit_model(record_of(path=swells), FitSettings(order=ORDER, delay_s=0.0))
RECORD = record_of(path=swells)


def test_without_another_record_there_is_no_test() -> None:
    """The record itself and its blocks are judged all the same."""
    judged = judge(FIT, RECORD, None)

    assert (judged.test, judged.test_offset_removed) == (None, None)
    assert judged.train == FIT.errors_pct(RECORD)
    assert judged.validation.errors == cross_validate(FIT).errors


def test_a_cross_validation_that_is_known_is_not_made_again() -> None:
    """It takes its time."""
    known = cross_validate(FIT, blocks=2)

    assert judge(FIT, RECORD, None, known).validation is known


@pytest.mark.parametrize("shift_um", [-0.6, 0.3])
def test_a_constant_offset_is_found_and_removed(shift_um: float) -> None:
    """A shift of the displacement is told as the offset, and errors are good without it."""
    shifted = replace(RECORD, position_um=RECORD.position_um + shift_um)

    judged = judge(FIT, RECORD, shifted)

    offset = judged.test_offset_removed
    assert judged.test
    assert offset
    assert offset.offset_um == pytest.approx(shift_um, rel=0.1)
    assert offset.offset_pct * shift_um > 0.0
    assert offset.errors["voltage_error_rms_pct"] < 0.4 * judged.test["voltage_error_rms_pct"]


def test_errors_without_an_offset_that_is_not_there_are_the_same() -> None:
    """On the record of the fit nearly nothing is constant in what it misses."""
    judged = judge(FIT, RECORD, RECORD)

    offset = judged.test_offset_removed
    assert judged.test and offset
    assert offset.offset_pct == pytest.approx(0.0, abs=1e-3)
    assert offset.errors == pytest.approx(judged.test, rel=0.05)
