"""The rows of piezod: every kind of model among which `piezod identify --method auto` chooses.

Nothing here names a method: a kind of candidates that the choice gets in future has a row too.
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from time import perf_counter

import numpy as np

from benchmarks.peers.evaluation import PREDICTIONS, rms, worst
from benchmarks.peers.method import Row
from benchmarks.peers.records import Case
from benchmarks.peers.table import PIEZOD
from piezod.experiment.fit.automatic import Candidate, Wanted, choose
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Method
from piezod.hysteresis import SurfaceForm

CHOSEN = f"{PIEZOD} auto"
_SIZE = "order"
"""Candidates that differ in this setting alone share a row, that of the best of them."""
_OF_STOPS = (_SIZE, "spacing")
"""Settings that a surface does not use."""


def rows_of_piezod(case: Case) -> list[Row]:
    """Return the row of the model that piezod chooses, and the best row of each kind of model."""
    started_s = perf_counter()
    choice = choose(case.record, Wanted(), case.delay_s)
    search_s = perf_counter() - started_s
    best: dict[str, Candidate] = {}
    for candidate in choice.candidates:
        kind = _kind(candidate, choice.candidates)
        other = best.get(kind)
        if other is None or candidate.validation.rms_pct < other.validation.rms_pct:
            best[kind] = candidate
    taken = _row(CHOSEN, choice.chosen, case, search_s)
    of_taken = _kind(choice.chosen, choice.candidates)
    return [
        replace(taken, setting=f"{of_taken}, {taken.setting}"),
        *(_row(f"{PIEZOD} {kind}", each, case, search_s) for kind, each in best.items()),
    ]


def _kind(candidate: Candidate, candidates: tuple[Candidate, ...]) -> str:
    """Return the settings, apart from the size, in which candidates differ, for people."""
    others = [_settings(each) for each in candidates]
    told = []
    for name, value in _settings(candidate).items():
        if name != _SIZE and any(other.get(name) != value for other in others):
            told.append(("" if value else "no ") + name if isinstance(value, bool) else str(value))
    return " ".join(told)


def _settings(candidate: Candidate) -> Mapping[str, object]:
    settings = asdict(candidate.fit.settings)
    if candidate.fit.settings.method is Method.SURFACE:
        return {name: value for name, value in settings.items() if name not in _OF_STOPS}
    return settings


def _found(candidate: Candidate) -> str:
    """Return what the fit has found beside the settings, for people: its size, or its terms."""
    match candidate.fit.model.form:
        case SurfaceForm(activation=activation, path=path):
            terms = ("rate lag", activation), ("path", path)
            return " and ".join(name for name, present in terms if present) or "no further term"
        case _:
            return f"{_SIZE} {candidate.fit.settings.order}"


def _row(name: str, candidate: Candidate, case: Case, search_s: float) -> Row:
    fit, errors = candidate.fit, candidate.validation.errors
    residuals = fit.residuals_pct(fit.as_fitted(case.test)) / 100.0
    residuals -= np.mean(residuals) if case.without_offset else 0.0
    fitting_s = perf_counter()
    fit_model(case.record, fit.settings)
    fitted_s = perf_counter()
    return Row(
        method=name,
        setting=_found(candidate),
        held_out_max_pct=errors["voltage_error_max_pct"],
        held_out_rms_pct=errors["voltage_error_rms_pct"],
        test_max_pct=worst(residuals),
        test_rms_pct=rms(residuals),
        fit_s=fitted_s - fitting_s,
        sample_us=_sample_us(candidate),
        search_s=search_s,
    )


def _sample_us(candidate: Candidate) -> float:
    fit, durations_s = candidate.fit, []
    for _ in range(PREDICTIONS):
        started_s = perf_counter()
        fit.predicted_v(fit.record)
        durations_s.append(perf_counter() - started_s)
    return 1e6 * min(durations_s) / fit.record.t_s.size
