"""Tests of the automatic choice if some or all candidates cannot be fitted."""

from dataclasses import replace

import pytest

from piezod.errors import DataError
from piezod.experiment.fit.automatic import Wanted, choose
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


def test_choice_reports_its_progress() -> None:
    """Each candidate is announced with the share that is done."""
    steps: list[tuple[str, float]] = []
    choice = choose(record_of(), Wanted(order=5), 0.0, lambda *step: steps.append(step))

    labels, shares = zip(*steps, strict=True)
    assert labels[0] == f"model 1 of {len(steps)}"
    assert shares == tuple(i / len(steps) for i in range(len(steps)))
    assert len(steps) >= len(choice.candidates)
