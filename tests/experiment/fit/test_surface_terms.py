"""Tests of the choice of the optional terms of a surface, with made-up fits."""

from typing import cast

import numpy as np
import pytest

from piezod.experiment.fit.surface import terms
from piezod.experiment.fit.surface.gauss_newton import LinearisedSurface
from piezod.experiment.fit.surface.parameters import COUNT, Term
from piezod.experiment.fit.surface.terms import LARGEST_RATIO, with_shown_terms
from piezod.hysteresis.memory import FloatArray

NONE: frozenset[Term] = frozenset()
BOTH = frozenset({Term.RATE, Term.PATH})


class MadeUpFit:
    """A fit of a straight line with given errors.

    Args:
        rms: Rms residual of the whole record.
        block: Rms error on each held-out block; the blocks differ by 2 %.
    """

    period_s = 1e-3

    def __init__(self, rms: float, block: float) -> None:
        self.rms = rms
        self.squares: FloatArray = (block * np.array([0.98, 1.0, 1.02, 0.99, 1.01])) ** 2
        self.parameters = np.zeros(COUNT)
        self.parameters[0] = 1.0


def shown(
    monkeypatch: pytest.MonkeyPatch,
    fits: dict[frozenset[Term], MadeUpFit],
    allowed: frozenset[Term],
) -> frozenset[Term]:
    """Return the terms of the fit that is taken."""

    def squares(fit: MadeUpFit) -> FloatArray:
        return fit.squares

    monkeypatch.setattr(terms, "held_out_squares", squares)
    found = with_shown_terms(lambda terms: cast(LinearisedSurface, fits[terms]), allowed)
    return next(terms for terms, fit in fits.items() if cast(LinearisedSurface, fit) is found)


@pytest.mark.parametrize("term", BOTH)
@pytest.mark.parametrize(("part", "taken"), [(0.99, True), (1.01, False)])
def test_a_term_is_taken_up_to_its_ratio(
    monkeypatch: pytest.MonkeyPatch, term: Term, part: float, taken: bool
) -> None:
    """The rms error on held-out blocks decides."""
    alone = frozenset({term})
    fits = {NONE: MadeUpFit(1.0, 1.0), alone: MadeUpFit(0.9, part * LARGEST_RATIO[term])}

    assert shown(monkeypatch, fits, alone) == (alone if taken else NONE)


@pytest.mark.parametrize("term", BOTH)
@pytest.mark.parametrize(("rms", "taken"), [(0.9999, True), (0.99999, False), (2.0, False)])
def test_the_residual_must_become_smaller_too(
    monkeypatch: pytest.MonkeyPatch, term: Term, rms: float, taken: bool
) -> None:
    """A gain too small to matter is not taken, nor a search that ended at a worse fit."""
    alone = frozenset({term})
    fits = {NONE: MadeUpFit(1.0, 1.0), alone: MadeUpFit(rms, 0.1)}

    assert shown(monkeypatch, fits, alone) == (alone if taken else NONE)


@pytest.mark.parametrize(("with_both", "taken"), [(0.13, BOTH), (0.15, {Term.RATE})])
def test_the_better_term_is_taken_first(
    monkeypatch: pytest.MonkeyPatch, with_both: float, taken: frozenset[Term]
) -> None:
    """Held-out blocks decide between two terms; the other one must then reach its own ratio."""
    fits = {
        NONE: MadeUpFit(1.0, 1.0),
        frozenset({Term.RATE}): MadeUpFit(0.3, 0.2),
        frozenset({Term.PATH}): MadeUpFit(0.2, 0.3),
        BOTH: MadeUpFit(0.1, with_both),
    }

    assert shown(monkeypatch, fits, BOTH) == taken


@pytest.mark.parametrize(("without_path", "taken"), [(0.3, True), (2.0, False)])
def test_the_exponent_is_tried_beside_a_path_only(
    monkeypatch: pytest.MonkeyPatch, without_path: float, taken: bool
) -> None:
    """Where the record does not show a path, no fit has an exponent."""
    path, allowed = frozenset({Term.PATH}), frozenset({Term.PATH, Term.EXPONENT})
    fits = {
        NONE: MadeUpFit(1.0, 1.0),
        path: MadeUpFit(without_path, without_path),
        allowed: MadeUpFit(0.1, 0.1),
    }

    assert shown(monkeypatch, fits, allowed) == (allowed if taken else NONE)
