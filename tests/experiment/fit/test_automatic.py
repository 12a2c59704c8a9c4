"""Tests of the automatic choice if some or all candidates cannot be fitted."""

from collections.abc import Sequence
from typing import cast

import numpy as np
import pytest

from piezod.control.law.model import StageModel
from piezod.errors import DataError
from piezod.experiment.fit.automatic import (
    Candidate,
    Wanted,
    choose,
    creep_is_shown,
    simplest_as_good,
)
from piezod.experiment.fit.errors import Block, CrossValidation
from piezod.experiment.fit.excitation import has_all_loops
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.residuals import Residuals
from piezod.experiment.fit.settings import FitSettings
from piezod.hysteresis.memory import FloatArray
from tests.experiment.made_up import record_of, sine
from tests.experiment.made_up_surface import surface_record


@pytest.mark.parametrize("delay_s", [None, 0.0])
def test_record_too_short_for_the_order_is_refused(delay_s: float | None) -> None:
    """The error is that of the last candidate, with a given or an estimated delay."""
    record = record_of(duration_s=9.0)

    with pytest.raises(DataError, match="900 samples are left for 400 weights"):
        choose(record, Wanted(order=200), delay_s)


def test_only_candidates_that_can_be_fitted_are_compared() -> None:
    """If the fit of the creep fails, the models without creep remain."""
    record = record_of(creep=0.3, duration_s=12.0)

    choice = choose(record, Wanted(order=5), 0.0)

    assert choice.candidates
    assert not any(each.fit.settings.creep for each in choice.candidates)


BLOCKS_PCT = (0.2, 0.2, 0.2, 0.2, 1.0)
"""Errors of four easy blocks and a hard one."""


class _Ordered:
    """A fit with a number of operators; nothing else of it counts."""

    def __init__(self, order: int) -> None:
        self.settings = FitSettings(order=order)


def candidate(
    order: int, position_pct: Sequence[float], voltage_pct: Sequence[float] = BLOCKS_PCT
) -> Candidate:
    """Return a candidate with constant errors in each block."""
    no_model = cast("StageModel", None)
    blocks = tuple(
        Block(0.0, 1.0, no_model, Residuals(np.full(10, voltage), np.full(10, position)))
        for voltage, position in zip(voltage_pct, position_pct, strict=True)
    )
    return Candidate(cast("Fit", _Ordered(order)), CrossValidation(blocks))


@pytest.mark.parametrize(
    ("position_pct", "voltage_pct", "order"),
    [
        ((0.21, 0.19, 0.22, 0.18, 1.01), BLOCKS_PCT, 5),  # by chance, and by 1 % only
        ((0.202, 0.202, 0.202, 0.202, 0.9998), BLOCKS_PCT, 30),  # almost everywhere
        ((0.2, 0.2, 0.2, 0.2, 1.15), BLOCKS_PCT, 30),  # by much, on the hard block only
        ((0.21, 0.19, 0.22, 0.18, 1.01), (0.25, 0.25, 0.25, 0.25, 1.05), 30),  # the voltage
    ],
)
def test_smaller_model_is_taken_only_if_it_costs_little(
    position_pct: Sequence[float], voltage_pct: Sequence[float], order: int
) -> None:
    """Its errors are at most 2 % larger, by no more than chance explains, block by block."""
    best = candidate(30, BLOCKS_PCT)
    choice = simplest_as_good((candidate(5, position_pct, voltage_pct), best))

    assert choice.chosen.fit.settings.order == order
    assert choice.limit_pct == pytest.approx(1.02 * choice.best.validation.position_rms_pct)


@pytest.mark.parametrize(
    ("position", "voltage", "order"), [(2.5, 0.5, 30), (0.9, 1.2, 30), (1.05, 0.9, 5)]
)
def test_both_errors_decide(position: float, voltage: float, order: int) -> None:
    """A small error of the voltage may hide drift, and that of the position may be mostly drift."""
    other = candidate(
        5, [position * each for each in BLOCKS_PCT], [voltage * each for each in BLOCKS_PCT]
    )
    choice = simplest_as_good((other, candidate(30, BLOCKS_PCT)))

    assert choice.chosen is choice.best
    assert choice.chosen.fit.settings.order == order


def test_held_out_blocks_decide_about_a_surface() -> None:
    """Without all loops it must be clearly better; with them it keeps its own delay."""
    poor = choose(record_of(path=sine, duration_s=12.0), Wanted(creep=False), None)
    rich = choose(surface_record(delay_s=-0.004, duration_s=20.0), Wanted(creep=False), None)

    for choice in (poor, rich):
        assert {each.fit.settings.method for each in choice.candidates} == set(Method)
    assert rich.chosen.fit.settings.method is Method.SURFACE
    assert rich.chosen.fit.model.delay_s == pytest.approx(-0.004, abs=2e-4)
    assert poor.chosen.fit.settings.method is not Method.SURFACE
    assert "does not have loops of all sizes" in poor.no_surface
    assert rich.no_surface == ""


def test_a_surface_that_is_clearly_better_is_taken_without_all_loops() -> None:
    """The record has loops of all sizes, but all of them begin at the lowest drive."""

    def shrinking(t_s: FloatArray) -> FloatArray:
        return 0.5 * np.exp(-t_s / 8.0) * (1.0 - np.cos(2.0 * np.pi * 0.8 * t_s))

    record = surface_record(drive=shrinking, duration_s=15.0)
    assert not has_all_loops(record)

    choice = choose(record, Wanted(creep=False), 0.0)

    assert choice.chosen.fit.settings.method is Method.SURFACE
    assert choice.no_surface == ""


def test_creep_is_tried_only_on_a_record_that_is_long_enough() -> None:
    """A short one has seen wider loops at most."""
    long, short = (
        choose(record_of(creep=0.005, duration_s=duration_s), Wanted(spacing=Spacing.GRADED), 0.0)
        for duration_s in (25.0, 9.0)
    )

    assert long.chosen.fit.settings.creep
    assert not any(each.fit.settings.creep for each in short.candidates)


def test_creep_counts_only_if_the_position_is_clearly_better_with_it() -> None:
    """A gain of less, or on one block alone, is no evidence."""
    without = candidate(12, BLOCKS_PCT)
    for position_pct, counts in (
        ((0.17, 0.18, 0.16, 0.17, 0.85), True),
        ((0.19, 0.19, 0.19, 0.19, 0.95), False),
        ((0.21, 0.21, 0.21, 0.21, 0.7), False),
    ):
        creeping = candidate(12, position_pct)
        creeping.fit.settings = FitSettings(order=12, creep=True)  # type: ignore[misc]  # made up
        assert creep_is_shown(creeping, (without, creeping)) == counts


def test_a_surface_is_tried_with_creep_and_without() -> None:
    """A stage without creep gets the surface without, which is as good and has fewer parameters."""
    choice = choose(surface_record(duration_s=20.0), Wanted(), 0.0)

    surfaces = [each for each in choice.candidates if each.fit.settings.method is Method.SURFACE]
    assert [each.fit.settings.creep for each in surfaces] == [False, True]
    assert choice.chosen is surfaces[0]


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [
        (Wanted(creep=False, surface=False), "the identifier of the axis learns operators only"),
        (Wanted(creep=False, order=12), "--order or --thresholds asks for operators"),
    ],
)
def test_a_surface_is_not_tried_if_it_is_excluded(wanted: Wanted, reason: str) -> None:
    """A record with all loops is then described by operators, and the choice says why."""
    choice = choose(surface_record(duration_s=20.0), wanted, 0.0)

    methods = {each.fit.settings.method for each in choice.candidates}
    assert methods == {Method.LMS, Method.LEAST_SQUARES}
    assert reason in choice.no_surface


def test_few_operators_are_tried_only_on_short_records() -> None:
    """A coarse model that is best on one record is so by chance."""
    long, short = (
        choose(record_of(duration_s=duration_s), Wanted(spacing=Spacing.EVEN, creep=False), 0.0)
        for duration_s in (12.0, 2.5)
    )

    assert {each.fit.settings.order for each in long.candidates} == {12, 19, 30}
    assert {each.fit.settings.order for each in short.candidates} == {12, 19}


def test_choice_reports_its_progress() -> None:
    """Each candidate is announced with the share that is done."""
    steps: list[tuple[str, float]] = []
    choice = choose(record_of(), Wanted(order=5), 0.0, lambda *step: steps.append(step))

    labels, shares = zip(*steps, strict=True)
    assert labels[0] == f"model 1 of {len(steps)}"
    assert shares == tuple(i / len(steps) for i in range(len(steps)))
    assert len(steps) >= len(choice.candidates)
