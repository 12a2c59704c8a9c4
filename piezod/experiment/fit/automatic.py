"""Chooses a model by cross-validation: candidates are compared on data they were not fitted to.

The best candidate is that with the smallest product of two rms errors: of the position that it
predicts from the voltage, and of the voltage that it predicts from the position. The error of the
voltage hides the drift of the return points; if they drift, that dominates the position, and only
the voltage shows the loops. A product needs no weights: a share lost counts as much as one gained.

The choice is the simplest candidate that is as good as the best one: each of its rms errors is at
most 2 % larger, and by no more than chance explains.

A part needs evidence. Creep is tried on records that are long enough to show it, and counts only if
it makes the held-out position clearly better than the same model without. A surface extrapolates
badly to loops that its record does not have: on a record without all loops it counts only if
position and voltage are clearly better than by any operators.

All candidates are judged on the same blocks, so that chance is the standard error of the paired
difference of their mean squared errors, block by block. The standard error of one candidate
(Breiman et al. 1984) is mostly that of the blocks, which differ in difficulty: it once took 5
operators, 0.576 %, where 30 had 0.499 %. The paired one alone would excuse a model that is worse on
one difficult block, and 2 % alone one that is worse everywhere by a little less.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.errors import DataError, ModelError
from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.errors import CrossValidation, cross_validate
from piezod.experiment.fit.excitation import has_all_loops, shows_creep
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.residuals import (
    BLOCKS,
    CLEAR_GAIN,
    clearly_better,
    standard_error,
)
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.smoothing import smoothed_record
from piezod.experiment.progress import Progress

ORDERS = (5, 8, 12, 19, 30)
"""Numbers of operators on each side that are tried; the paper has 19."""
COARSE = 8
"""Up to this number they are tried only if the record is too short for more. So few operators do
not describe the loops; if they predict the position of one record best, that is chance: 5 and 8 did
so on two records, and were worse on the tests."""
LARGEST_LOSS = 1.02
"""Largest rms error of the chosen model, as a multiple of that of the best one."""
CREEP_STANDARD_ERRORS, SURFACE_STANDARD_ERRORS = 1.0, 2.0
"""Least mean gain of the blocks: creep shows only in some blocks, those with slow motion."""
_OFFSET, _RATE, _PATH, _EXPONENT, _MODE = 1, 2, 3, 1, 3
# Of a surface: a lag with the rate and a prompt slope; weight, decay and skew of a path, and its
# exponent; frequency, damping and lag of a mode.
REFERENCE_ORDER = 19
"""Largest number of operators of the model that estimates the delay."""


@dataclass(frozen=True)
class Wanted:
    """Fixed part of an automatic choice; None means free."""

    #: Operators on each side; if it or `spacing` is given, no surface is tried.
    order: int | None = None
    spacing: Spacing | None = None  #: Position of the thresholds.
    creep: bool | None = None  #: Whether creep is fitted.
    surface: bool = True  #: Whether a surface may be tried.


@dataclass(frozen=True)
class Candidate:
    """A candidate of the choice."""

    fit: Fit  #: Fit to the whole record.
    validation: CrossValidation  #: Errors of prediction on held-out data.

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters."""
        settings = self.fit.settings
        if settings.method is Method.SURFACE:
            slow = TIME_CONSTANTS_S.size * bool(settings.creep)
            optional = (
                _RATE * (self.fit.rate_lag > 0.0)
                + _PATH * (self.fit.path is not None)
                + _EXPONENT * (self.fit.path is not None and self.fit.path.exponent != 1.0)
                + _MODE * (self.fit.shows_mode is not None)
            )
            return settings.n_weights + _OFFSET + slow + optional
        return settings.n_weights + bool(settings.creep)


@dataclass(frozen=True)
class Choice:
    """Result of an automatic choice."""

    candidates: tuple[Candidate, ...]  #: All candidates, in the order of their fit.
    #: The candidate with the smallest product of the rms errors of position and voltage.
    best: Candidate
    chosen: Candidate  #: The simplest candidate that is as good.
    limit_pct: (
        float  #: Largest rms error of the position that is as good as that of the best, in %.
    )
    no_surface: str = ""  #: That a surface was not tried or does not count, and why; or empty.


def choose(
    record: Record,
    wanted: Wanted,
    delay_s: float | None,
    progress: Progress = lambda _label, _share: None,
) -> Choice:
    """Fit all candidates to a record and choose among them.

    The delay is estimated once for all stop operators. A surface fits its own, which may be
    negative; a record of one frequency does not determine it.

    Args:
        record: Drive and displacement.
        wanted: Fixed part of the choice.
        delay_s: Delay in s; estimated if None.
        progress: Called with the present candidate and the share that is done.

    Raises:
        DataError: If the record is too short for any candidate, or cannot be used.
    """
    estimate = None if delay_s is not None else _delay(record, wanted)
    if estimate is not None:
        delay_s = estimate.delay_s
    no_surface = _no_surface(wanted)
    tried = tuple(_settings(record, wanted, surface=not no_surface))
    candidates = _candidates(record, tried, delay_s, estimate, progress)
    shown = tuple(each for each in candidates if creep_is_shown(each, candidates))
    if not has_all_loops(smoothed_record(record)):
        counting = tuple(each for each in shown if _is_better_than_operators(each, shown))
        if _has_surface(shown) and not _has_surface(counting):
            no_surface = (
                "does not count, because the record does not have loops of all sizes and heights "
                "(below), and held-out blocks do not show that it is clearly better"
            )
        shown = counting
    chosen = simplest_as_good(shown)
    return replace(chosen, candidates=candidates, no_surface=no_surface)


def creep_is_shown(candidate: Candidate, candidates: tuple[Candidate, ...]) -> bool:
    """Return whether a candidate has no creep, or is clearly better than the same one without."""
    return not candidate.fit.settings.creep or all(
        clearly_better(
            candidate.validation.squares.position_pct,
            each.validation.squares.position_pct,
            CLEAR_GAIN,
            CREEP_STANDARD_ERRORS,
        )
        for each in candidates
        if not each.fit.settings.creep and _kind(each) == _kind(candidate)
    )


def _kind(candidate: Candidate) -> tuple[Method, int, Spacing]:
    settings = candidate.fit.settings
    return settings.method, settings.order, settings.spacing


def _has_surface(candidates: tuple[Candidate, ...]) -> bool:
    return any(each.fit.settings.method is Method.SURFACE for each in candidates)


def _is_better_than_operators(candidate: Candidate, candidates: tuple[Candidate, ...]) -> bool:
    """Return whether a candidate is no surface, or clearly better than the best operators."""
    operators = [each for each in candidates if each.fit.settings.method is not Method.SURFACE]
    if candidate in operators or not operators:
        return True
    best = min(operators, key=_product)
    pairs = zip(candidate.validation.squares, best.validation.squares, strict=True)
    return all(clearly_better(*pair, CLEAR_GAIN, SURFACE_STANDARD_ERRORS) for pair in pairs)


def simplest_as_good(candidates: tuple[Candidate, ...]) -> Choice:
    """Choose, among the candidates that are as good as the best, that with fewest parameters."""
    best = min(candidates, key=_product)
    limit_pct = LARGEST_LOSS * best.validation.position_rms_pct
    as_good = [each for each in candidates if each is best or _as_good(each, best)]
    chosen = min(as_good, key=lambda each: (each.n_parameters, _product(each)))
    return Choice(candidates, best, chosen, limit_pct)


def _product(candidate: Candidate) -> float:
    errors = candidate.validation.errors
    return errors["position_error_rms_pct"] * errors["voltage_error_rms_pct"]


def _as_good(candidate: Candidate, best: Candidate) -> bool:
    """Return whether neither error of a candidate exceeds that of the best one by much."""
    pairs = zip(candidate.validation.squares, best.validation.squares, strict=True)
    return all(
        float(np.mean(ours)) <= LARGEST_LOSS**2 * float(np.mean(best_s))
        and float(np.mean(ours - best_s)) <= standard_error(ours - best_s)
        for ours, best_s in pairs
    )


def _candidates(
    record: Record,
    tried: tuple[FitSettings, ...],
    delay_s: float | None,
    estimate: DelayEstimate | None,
    progress: Progress,
) -> tuple[Candidate, ...]:
    """Return the candidates that the record supports, at least one."""
    candidates, refused = [], None
    for index, settings in enumerate(tried):
        progress(f"model {index + 1} of {len(tried)}", index / len(tried))
        try:
            fit = _fitted(record, settings, delay_s, estimate)
            candidates.append(Candidate(fit, cross_validate(fit)))
        except (DataError, ModelError) as error:  # for example if a record contains no creep
            refused = error
    if refused and not candidates:
        raise refused
    return tuple(candidates)


def _fitted(
    record: Record, settings: FitSettings, delay_s: float | None, estimate: DelayEstimate | None
) -> Fit:
    if settings.method is Method.SURFACE and estimate and not estimate.one_frequency:
        return fit_model(record, settings)
    return replace(fit_model(record, replace(settings, delay_s=delay_s)), delay=estimate)


def _delay(record: Record, wanted: Wanted) -> DelayEstimate | None:
    order = min(wanted.order or _affordable(record)[-1], REFERENCE_ORDER)
    settings = FitSettings(order=order, spacing=Spacing.GRADED)
    if wanted.creep is not False:
        with suppress(DataError):
            return fit_model(record, replace(settings, creep=True)).delay
    return fit_model(record, settings).delay


def _no_surface(wanted: Wanted) -> str:
    """Return that no surface is tried, and why; empty if one is."""
    if not wanted.surface:
        return "was not tried, because the identifier of the axis learns operators only"
    if wanted.order is not None or wanted.spacing is not None:
        return "was not tried, because --order or --thresholds asks for operators"
    return ""


def _settings(record: Record, wanted: Wanted, *, surface: bool) -> Iterator[FitSettings]:
    orders = _affordable(record) if wanted.order is None else (wanted.order,)
    spacings = tuple(Spacing) if wanted.spacing is None else (wanted.spacing,)
    creeps: tuple[bool | None, ...] = (wanted.creep,)
    if wanted.creep is None:
        creeps = (False, True) if shows_creep(record) else (False,)
    # LMS fits neither creep nor other thresholds than even ones.
    if wanted.creep is not True and Spacing.EVEN in spacings:
        for order in orders:
            yield FitSettings(method=Method.LMS, order=order)
    for order, spacing, creep in product(orders, spacings, creeps):
        yield FitSettings(order=order, spacing=spacing, creep=creep)
    if surface:
        for creep in creeps:
            yield FitSettings(method=Method.SURFACE, creep=creep)


def _affordable(record: Record) -> tuple[int, ...]:
    """Return the orders for which a record without its longest block has enough samples."""
    n_samples = np.count_nonzero(record.counted())
    orders = tuple(order for order in ORDERS if _min_samples(order) <= n_samples)
    if not orders:
        raise DataError(
            f"{n_samples} samples are too few to choose a model by cross-validation; allowed are "
            f"{_min_samples(ORDERS[0])} or more; record for longer, or skip less"
        )
    return tuple(order for order in orders if order > COARSE) or orders


def _min_samples(order: int) -> int:
    # The fit without the longest block must still have enough samples per weight.
    return 2 * order * SAMPLES_PER_WEIGHT * BLOCKS // (BLOCKS - 1)
