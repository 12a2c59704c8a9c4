"""Errors on blocks of a record that the model was not fitted to."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from piezod.experiment.fit.cross_validation import cross_validate
from piezod.experiment.fit.fit import FitSettings, fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from tests.experiment.made_up import ORDER, record_of, swells

SETTINGS = FitSettings(order=ORDER, delay_s=0.0)


def with_a_fault(record: Record, start_s: float, end_s: float) -> Record:
    """Return a record of which part shows a loop that is not the stage's."""
    drive_v = record.drive_v.copy()
    drive_v[(record.t_s >= start_s) & (record.t_s < end_s)] += 15.0
    return replace(record, drive_v=drive_v)


@pytest.mark.parametrize("blocks", [2, 5, 7])
def test_blocks_are_contiguous_and_make_up_all_that_counts(blocks: int) -> None:
    """Each sample after the run-in is held out once."""
    record = record_of(path=swells).after(2.0)

    validation = cross_validate(fit_model(record, SETTINGS), blocks)

    found = validation.blocks
    assert len(found) == blocks
    assert found[0].start_s == pytest.approx(2.0)
    assert found[-1].end_s == record.t_s[-1]
    for before, after in pairwise(found):
        assert after.start_s - before.end_s == pytest.approx(record.period_s)
    sizes = [block.residuals_pct.size for block in found]
    assert sum(sizes) == np.count_nonzero(record.counted())
    assert max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("creep", [False, True])
def test_a_block_s_model_does_not_know_the_block(method: Method, creep: bool) -> None:
    """What is wrong within a block spoils all models but its own."""
    if method is Method.LMS and creep:
        creep = False
    record = with_a_fault(record_of(path=swells), 5.0, 10.0)
    fit = fit_model(record, replace(SETTINGS, method=method, creep=creep))

    models = [block.model for block in cross_validate(fit).blocks]

    clean = fit_model(record_of(path=swells), replace(SETTINGS, method=method)).model.weights
    far = [float(np.max(np.abs(model.weights - clean))) for model in models]
    assert far[1] == min(far)
    assert far[1] < 0.5 * min(far[:1] + far[2:])


def test_errors_are_those_of_all_blocks_together() -> None:
    """The worst of all, and the rms over all samples; that of a block is its own."""
    record = with_a_fault(record_of(path=swells), 5.0, 10.0)
    validation = cross_validate(fit_model(record, SETTINGS))

    own = [block.errors for block in validation.blocks]
    assert validation.errors["voltage_error_max_pct"] == max(
        each["voltage_error_max_pct"] for each in own
    )
    squares = [each["voltage_error_rms_pct"] ** 2 for each in own]
    assert validation.rms_pct == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-3)
    assert max(own, key=lambda each: each["voltage_error_rms_pct"]) is own[1]


def test_standard_error_is_that_of_the_mean_square_over_blocks() -> None:
    """By hand, from the blocks' mean squares."""
    record = with_a_fault(record_of(path=swells), 5.0, 10.0)
    validation = cross_validate(fit_model(record, SETTINGS))

    squares = [float(np.mean(block.residuals_pct**2)) for block in validation.blocks]
    expected = np.sqrt(np.mean(squares) + np.std(squares, ddof=1) / np.sqrt(5.0))
    assert validation.rms_with_standard_error_pct == pytest.approx(expected)
    assert validation.rms_with_standard_error_pct > validation.rms_pct


def test_a_stage_that_is_like_the_model_is_predicted_as_well_where_it_was_not_seen() -> None:
    """Without noise, hysteresis alone, loops alike all along: what is learned carries over."""
    record = record_of(path=swells)
    fit = fit_model(record, SETTINGS)

    assert cross_validate(fit).rms_pct < 3.0 * fit.errors_pct(record)["voltage_error_rms_pct"]
