"""Chooses a model by cross-validation: candidates are compared on data they were not fitted to.

The choice is the simplest candidate whose mean squared error is within one standard error of the
best one (Breiman et al. 1984). A difference that chance explains is not worth more parameters.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeAlias

import numpy as np

from piezod.config.rules import SAMPLES_PER_WEIGHT
from piezod.errors import DataError
from piezod.experiment.fit.cross_validation import BLOCKS, CrossValidation, cross_validate
from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.fit import Fit, fit_model
from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings

ORDERS = (5, 8, 12, 19, 30)
"""Numbers of operators on each side that are tried; the paper has 19."""
_SLOW_PARAMETERS = 3  # creep, offset, stretch
REFERENCE_ORDER = 19
"""Largest number of operators of the model that estimates the delay."""

Progress: TypeAlias = Callable[[str, float], None]
"""Called with the present step and the share that is done, 0 to 1."""


@dataclass(frozen=True)
class Wanted:
    """Fixed part of an automatic choice; None means free.

    Attributes:
        order: Operators on each side.
        spacing: Position of the thresholds.
        creep: Whether creep is fitted.
    """

    order: int | None = None
    spacing: Spacing | None = None
    creep: bool | None = None


@dataclass(frozen=True)
class Candidate:
    """A candidate of the choice.

    Attributes:
        fit: Fit to the whole record.
        validation: Errors of prediction on held-out data.
    """

    fit: Fit
    validation: CrossValidation

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters."""
        settings = self.fit.settings
        return 2 * settings.order + _SLOW_PARAMETERS * settings.creep


@dataclass(frozen=True)
class Choice:
    """Result of an automatic choice.

    Attributes:
        candidates: All candidates, in the order of their fit.
        best: The candidate with the smallest rms error.
        taken: The simplest candidate that is as good.
        limit_pct: Largest rms error that counts as good as the best, in %.
    """

    candidates: tuple[Candidate, ...]
    best: Candidate
    taken: Candidate
    limit_pct: float


def choose(
    record: Record,
    wanted: Wanted,
    delay_s: float | None,
    progress: Progress = lambda _label, _share: None,
) -> Choice:
    """Fit all candidates to a record and choose among them.

    The delay is estimated once, so that all candidates are compared on the same pairs of drive and
    displacement.

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
    candidates = _candidates(record, wanted, delay_s, estimate, progress)
    # One-standard-error rule: among candidates as good as the best, the one with the fewest
    # parameters.
    best = min(candidates, key=lambda each: each.validation.rms_pct)
    limit_pct = best.validation.rms_with_standard_error_pct
    as_good = [each for each in candidates if each.validation.rms_pct <= limit_pct]
    taken = min(as_good, key=lambda each: (each.n_parameters, each.validation.rms_pct))
    return Choice(candidates, best, taken, limit_pct)


def _candidates(
    record: Record,
    wanted: Wanted,
    delay_s: float | None,
    estimate: DelayEstimate | None,
    progress: Progress,
) -> tuple[Candidate, ...]:
    """Return the candidates that the record supports, at least one."""
    candidates, refused = [], None
    tried = tuple(_settings(record, wanted))
    for index, settings in enumerate(tried):
        progress(f"model {index + 1} of {len(tried)}", index / len(tried))
        try:
            fit = replace(fit_model(record, replace(settings, delay_s=delay_s)), delay=estimate)
            candidates.append(Candidate(fit, cross_validate(fit)))
        except DataError as error:  # for example if a record contains no creep
            refused = error
    if refused and not candidates:
        raise refused
    return tuple(candidates)


def _delay(record: Record, wanted: Wanted) -> DelayEstimate | None:
    order = min(wanted.order or _affordable(record)[-1], REFERENCE_ORDER)
    settings = FitSettings(order=order, spacing=Spacing.GRADED)
    if wanted.creep is not False:
        with suppress(DataError):
            return fit_model(record, replace(settings, creep=True)).delay
    return fit_model(record, settings).delay


def _settings(record: Record, wanted: Wanted) -> Iterator[FitSettings]:
    orders = _affordable(record) if wanted.order is None else (wanted.order,)
    spacings = tuple(Spacing) if wanted.spacing is None else (wanted.spacing,)
    creeps = (False, True) if wanted.creep is None else (wanted.creep,)
    # LMS fits neither creep nor other thresholds than even ones.
    if wanted.creep is not True and Spacing.EVEN in spacings:
        for order in orders:
            yield FitSettings(method=Method.LMS, order=order)
    for order, spacing, creep in product(orders, spacings, creeps):
        yield FitSettings(order=order, spacing=spacing, creep=creep)


def _affordable(record: Record) -> tuple[int, ...]:
    """Return the orders for which a record without its longest block has enough samples."""
    n_samples = np.count_nonzero(record.counted())
    orders = tuple(order for order in ORDERS if _min_samples(order) <= n_samples)
    if not orders:
        raise DataError(
            f"{n_samples} samples are too few to choose a model by cross-validation; allowed are "
            f"{_min_samples(ORDERS[0])} or more; record for longer, or skip less"
        )
    return orders


def _min_samples(order: int) -> int:
    # The fit without the longest block must still have enough samples per weight.
    return 2 * order * SAMPLES_PER_WEIGHT * BLOCKS // (BLOCKS - 1)
