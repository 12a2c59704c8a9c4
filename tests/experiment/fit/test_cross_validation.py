"""Tests of errors on held-out blocks of a record."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from piezod.experiment.fit.errors import cross_validate
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from tests.experiment.made_up import ORDER, record_of, swells

SETTINGS = FitSettings(order=ORDER, delay_s=0.0)


def with_a_fault(record: Record, start_s: float, end_s: float) -> Record:
    """Return a record with a part whose loop is not that of the stage."""
    drive_v = record.drive_v.copy()
    drive_v[(record.t_s >= start_s) & (record.t_s < end_s)] += 15.0
    return replace(record, drive_v=drive_v)


@pytest.mark.parametrize("blocks", [2, 5, 7])
def test_blocks_are_contiguous_and_contain_all_samples_that_count(blocks: int) -> None:
    """Each sample after the run-in is held out once."""
    record = record_of(path=swells).after(2.0)

    validation = cross_validate(fit_model(record, SETTINGS), blocks)

    found = validation.blocks
    assert len(found) == blocks
    assert found[0].start_s == pytest.approx(2.0)
    assert found[-1].end_s == record.t_s[-1]
    for before, after in pairwise(found):
        assert after.start_s - before.end_s == pytest.approx(record.period_s)
    sizes = [block.residuals.voltage_pct.size for block in found]
    assert sum(sizes) == np.count_nonzero(record.counted())
    assert max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("creep", [False, True])
def test_model_of_a_block_is_not_fitted_to_it(method: Method, creep: bool) -> None:
    """An error within a block changes all models but its own."""
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
    """They are the worst of all and the rms over all samples; each block also has its own."""
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
    """It follows from the mean squares of the blocks."""
    record = with_a_fault(record_of(path=swells), 5.0, 10.0)
    validation = cross_validate(fit_model(record, SETTINGS))

    squares = [float(np.mean(block.residuals.voltage_pct**2)) for block in validation.blocks]
    expected = np.sqrt(np.mean(squares) + np.std(squares, ddof=1) / np.sqrt(5.0))
    assert validation.rms_with_standard_error_pct == pytest.approx(expected)
    assert validation.rms_with_standard_error_pct > validation.rms_pct


def test_held_out_blocks_of_a_modelled_stage_are_predicted_as_well() -> None:
    """Without noise, and with similar loops everywhere, the model holds for each block."""
    record = record_of(path=swells)
    fit = fit_model(record, SETTINGS)

    assert cross_validate(fit).rms_pct < 3.0 * fit.errors_pct(record)["voltage_error_rms_pct"]
