"""Tests of the automatic choice if some or all candidates cannot be fitted."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from piezod.control.law.model import StageModel
from piezod.errors import DataError
from piezod.experiment.fit.automatic import Candidate, Wanted, choose, simplest_as_good
from piezod.experiment.fit.cross_validation import Block, CrossValidation
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.residuals import Residuals
from piezod.experiment.fit.settings import FitSettings
from tests.experiment.made_up import record_of


@pytest.mark.parametrize("delay_s", [None, 0.0])
def test_record_too_short_for_the_order_is_refused(delay_s: float | None) -> None:
    """The error is that of the last candidate, with a given or an estimated delay."""
    record = record_of(duration_s=9.0)

    with pytest.raises(DataError, match="900 samples are left for 400 weights"):
        choose(record, Wanted(order=200), delay_s)


def test_sensor_with_the_wrong_sign_is_refused() -> None:
    """No candidate can be fitted, and the error names the remedy."""
    record = record_of()
    inverted = replace(record, position_um=-record.position_um)

    with pytest.raises(DataError, match="change the sign of one of them"):
        choose(inverted, Wanted(order=5), 0.0)


def test_only_candidates_that_can_be_fitted_are_compared() -> None:
    """If the fit of the creep fails, the models without creep remain."""
    record = record_of(creep=0.3, duration_s=12.0)

    choice = choose(record, Wanted(order=5), 0.0)

    assert choice.candidates
    assert not any(each.fit.settings.creep for each in choice.candidates)


class _Ordered:
    """A fit with a number of operators; nothing else of it counts."""

    def __init__(self, order: int) -> None:
        self.settings = FitSettings(order=order)


def candidate(order: int, factor: float) -> Candidate:
    """Return a candidate with errors in proportion to a factor, on an easy and a hard block."""
    no_model = cast("StageModel", None)
    blocks = tuple(
        Block(0.0, 1.0, no_model, Residuals(factor * np.full(10, size), factor * np.full(10, size)))
        for size in (0.2, 0.2, 0.2, 0.2, 1.0)
    )
    return Candidate(cast("Fit", _Ordered(order)), CrossValidation(blocks))


@pytest.mark.parametrize(("factor", "order"), [(1.15, 30), (1.03, 5)])
def test_smaller_model_is_taken_only_if_it_costs_little(factor: float, order: int) -> None:
    """Blocks of different difficulty have a large standard error, which excuses no worse model."""
    choice = simplest_as_good((candidate(5, factor), candidate(30, 1.0)))

    assert choice.best.validation.rms_with_standard_error_pct > 1.3 * choice.best.validation.rms_pct
    assert choice.taken.fit.settings.order == order
    assert choice.limit_pct == pytest.approx(1.05 * choice.best.validation.rms_pct)


def test_choice_reports_its_progress() -> None:
    """Each candidate is announced with the share that is done."""
    steps: list[tuple[str, float]] = []
    choice = choose(record_of(), Wanted(order=5), 0.0, lambda *step: steps.append(step))

    labels, shares = zip(*steps, strict=True)
    assert labels[0] == f"model 1 of {len(steps)}"
    assert shares == tuple(i / len(steps) for i in range(len(steps)))
    assert len(steps) >= len(choice.candidates)
