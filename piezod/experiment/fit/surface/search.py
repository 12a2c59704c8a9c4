"""The search for the surface of a record: without the first mode, and with it if it is shown."""

from dataclasses import replace
from typing import NamedTuple

from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.surface.first_mode import ShownMode, shown_mode
from piezod.experiment.fit.surface.gauss_newton import LinearisedSurface
from piezod.experiment.fit.surface.problem import SurfaceProblem


class FoundSurface(NamedTuple):
    """Result of a search."""

    problem: SurfaceProblem  #: The problem that was solved.
    settings: FitSettings  #: Settings of the fit: with a mode, the displacement is not smoothed.
    linearised: LinearisedSurface  #: The problem, linear around its solution.
    #: How clearly the record shows the first mode; None if it does not.
    shows_mode: ShownMode | None


def search_surface(
    record: Record, settings: FitSettings, start_s: float, *, one_frequency: bool
) -> FoundSurface:
    """Return the best surface of a record.

    Args:
        record: The record, not smoothed.
        settings: Settings of the fit.
        start_s: Delay, or the start of its search if the settings give none, in s.
        one_frequency: Whether the drive has a single frequency: it shows neither the delay nor the
            mode, nor the optional terms.
    """
    search_delay = settings.delay_s is None and not one_frequency
    problem = SurfaceProblem(settings.as_fitted(record), settings)
    plain = problem.solve(start_s, search_delay=search_delay, search_terms=not one_frequency)
    without_mode = FoundSurface(problem, settings, plain, None)
    guess = None if one_frequency else problem.guessed_mode(plain, record.position_um)
    if guess is None:
        return without_mode
    # Smoothing would remove the vibration from the displacement.
    unsmoothed = replace(settings, smoothing=False)
    if problem.record is not record:
        problem = SurfaceProblem(record, unsmoothed)
        plain = problem.solve(start_s, search_delay=search_delay, search_terms=True)
    begin_s = guess.delay_s if search_delay else start_s
    with_mode = problem.solve(begin_s, search_delay=search_delay, search_terms=True, mode=guess)
    model = problem.model(with_mode.parameters)
    unit = problem.position_um.width / model.position_um.width
    shows_mode = shown_mode(model.mode, with_mode, plain, unit) if model.mode else None
    if shows_mode is None:
        return without_mode
    return FoundSurface(problem, unsmoothed, with_mode, shows_mode)
