"""The choice of the optional terms of a surface: only those that the record shows."""

from collections.abc import Callable, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np

from piezod.experiment.fit.residuals import clearly_better, held_out_squares
from piezod.experiment.fit.surface.gauss_newton import LinearisedSurface
from piezod.experiment.fit.surface.parameters import Term, form_of
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.memory import FloatArray

LARGEST_RATIO: Final[Mapping[Term, float]] = MappingProxyType(
    {Term.RATE: 0.9, Term.PATH: 0.7, Term.EXPONENT: 0.9}
)
"""A term is part of the model if it makes the rms error of the position on held-out blocks smaller
by at least this factor, and by more than chance. The path is searched beside a fitted creep only,
because it would imitate the creep."""
STANDARD_ERRORS: Final = 2.0
"""Least mean gain of the blocks: with a gain that drifts and noise, a lag with the rate that is not
there gained up to 1.96."""
LEAST_GAIN: Final = 5e-5
"""It must also make the rms residual of the whole record smaller by this share of the range: less
is not worth a term, and a search may end at a worse fit, where the blocks say nothing."""

Fitted: TypeAlias = Callable[[frozenset[Term]], LinearisedSurface]
"""Returns the best surface with these terms."""


class _Trial:
    """A fit with its errors on held-out blocks, which are computed once, if at all."""

    def __init__(self, fit: LinearisedSurface) -> None:
        self.fit = fit

    @cached_property
    def squares(self) -> FloatArray:
        """Mean squared error of each block, shape (blocks,)."""
        return held_out_squares(self.fit)


def with_shown_terms(fitted: Fitted, allowed: frozenset[Term]) -> LinearisedSurface:
    """Return the fit with the terms that a record shows, found one after the other."""
    terms: frozenset[Term] = frozenset()
    found = _Trial(fitted(terms))
    while terms < allowed:
        tried = allowed - terms
        if Term.PATH not in terms:
            tried -= {Term.EXPONENT}
        trials = {term: _Trial(fitted(terms | {term})) for term in tried}
        shown = [term for term, trial in trials.items() if _shows(term, trial, found)]
        if not shown:
            break
        best = min(shown, key=lambda term: float(np.mean(trials[term].squares)))
        terms, found = terms | {best}, trials[best]
    return found.fit


def _shows(term: Term, trial: _Trial, without: _Trial) -> bool:
    fit = trial.fit
    if fit.rms > without.fit.rms - LEAST_GAIN:
        return False
    # With a path, the bound of a fit is that of the skew before its last step.
    form = form_of(fit.parameters, fit.period_s)
    if form.smallest_slope(fit.parameters[:SIZE]) <= 0.0:
        return False
    return clearly_better(trial.squares, without.squares, LARGEST_RATIO[term], STANDARD_ERRORS)
