"""A record with its ranges, and the parts of the fit of a surface to it."""

from dataclasses import replace

import numpy as np

from piezod.control.law.creep import NO_CREEP, TIME_CONSTANTS_S, CreepLaw
from piezod.control.law.model import StageModel
from piezod.experiment.fit.delay import DelayEstimate
from piezod.experiment.fit.problem import LinearProblem, Problem
from piezod.experiment.fit.record import Rows
from piezod.experiment.fit.surface.first_mode import ModeGuess, guess_mode
from piezod.experiment.fit.surface.gauss_newton import LinearisedSurface, fit_surface
from piezod.experiment.fit.surface.parameters import (
    CREEP,
    DELAY,
    OFFSET,
    Term,
    form_of,
    mode_of,
)
from piezod.experiment.fit.surface.point import Point, SurfaceRecord
from piezod.experiment.fit.surface.terms import with_shown_terms
from piezod.hysteresis import AffineRange
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.memory import FloatArray

_PERIODS = 2.0
"""Delays up to this many sample periods around the best one are reported, with their errors."""
_STEPS = 40


class SurfaceProblem(Problem):
    """A record with its ranges, and the parts of the fit of a surface."""

    def solve(
        self,
        delay_s: float,
        *,
        search_delay: bool,
        search_terms: bool,
        mode: ModeGuess | None = None,
    ) -> LinearisedSurface:
        """Return the best surface, with its creep if `creep` is set.

        Args:
            delay_s: Delay, or the start of its search, in s.
            search_delay: Whether the delay is searched.
            search_terms: Whether the optional terms are searched, which one frequency cannot show.
            mode: First mode at which its search begins; None if none is searched.
        """
        record = self._normalised(delay_s)

        def fitted(terms: frozenset[Term]) -> LinearisedSurface:
            return fit_surface(
                record,
                creep=bool(self._settings.creep),
                delay_s=None if search_delay else delay_s,
                start_delay_s=delay_s,
                terms=terms,
                mode=mode,
            )

        terms = tuple(Term) if self._settings.creep else (Term.RATE,)
        allowed = frozenset(terms if search_terms else ())
        found = with_shown_terms(fitted, allowed)
        # The first samples that count depend on the delay that was found.
        found_s = float(found.parameters[DELAY]) * self.record.period_s
        return replace(found, counted=self.record.counted(found_s))

    def guessed_mode(self, plain: LinearisedSurface, position_um: FloatArray) -> ModeGuess | None:
        """Return the mode that the record may show, None if there is none.

        Args:
            plain: A fit without a mode.
            position_um: (n,) displacement as recorded: smoothing would remove a vibration.
        """
        delay_s = float(plain.parameters[DELAY]) * self.record.period_s
        normalised, at_once = self._normalised(delay_s), plain.parameters.copy()
        at_once[DELAY] = 0.0
        held = Point.at(normalised, at_once).predicted
        recorded = self.position_um.to_unit(position_um)
        return guess_mode(held, recorded, plain.counted, self.record.period_s, delay_s)

    def _normalised(self, delay_s: float) -> SurfaceRecord:
        """Return the record of a search that begins at a delay in s."""
        record = self.record
        positions = self.position_um.to_unit(record.position_um)
        return SurfaceRecord(
            drives_at=lambda at_s: self.drive_v.to_unit(record.drive_delayed_by(at_s)),
            positions=positions,
            period_s=record.period_s,
            before=float(positions[0] if record.from_rest else np.mean(positions)),
            counted=record.counted(delay_s),
        )

    def model(self, parameters: FloatArray) -> StageModel:
        """Return the model of fitted parameters, shape (43,), in V and µm."""
        coefficients, weights = parameters[:SIZE], parameters[CREEP:OFFSET]
        form = form_of(parameters, self.record.period_s)
        # [0, 1] becomes the range of the displacement without creep at the drives [0, 1].
        top = form.rise(coefficients)
        width_um = self.position_um.width
        low_um = self.position_um.low + float(parameters[OFFSET]) * width_um
        return StageModel(
            form.in_units_of(top),
            coefficients / top,
            self.drive_v,
            AffineRange.checked(low_um, low_um + top * width_um),
            float(parameters[DELAY]) * self.record.period_s,
            CreepLaw(TIME_CONSTANTS_S, weights.copy()) if weights.any() else NO_CREEP,
            mode_of(parameters, self.record.period_s),
        )

    def without(
        self,
        model: StageModel,  # noqa: ARG002 - the linear problem has all of it
        linearised: LinearProblem | None,
        held_out: Rows,
    ) -> StageModel:
        """Return the model of the record without some samples, as `Problem.without`."""
        assert linearised is not None  # noqa: S101 - a surface is always fitted by least squares
        return self.model(linearised.solved(linearised.counted & ~held_out))

    def delay(self, linearised: LinearisedSurface) -> DelayEstimate:
        """Return the delay with its uncertainty, and the errors of delays around it."""
        period_s, counted = self.record.period_s, linearised.counted
        best = float(linearised.parameters[DELAY])
        periods = best + np.linspace(-_PERIODS, _PERIODS, _STEPS + 1)
        # Each other delay with the other parameters that fit best to it: a projection.
        others, _ = np.linalg.qr(linearised.regressors[counted][:, linearised.searched_but(DELAY)])
        shift = linearised.regressors[counted, DELAY]
        misses = linearised.misses[counted]
        shift, misses = (each - others @ (others.T @ each) for each in (shift, misses))
        squares = [np.mean((misses + (each - best) * shift) ** 2) for each in periods]
        rms = float(np.sqrt(np.mean(misses**2)))
        return DelayEstimate(
            delay_s=best * period_s,
            candidates_s=periods * period_s,
            criterion_pct=100.0 * np.sqrt(np.array(squares)),
            one_frequency=False,
            # The shift that could hide in the remaining error.
            uncertainty_s=rms / float(np.sqrt(np.mean(shift**2))) * period_s,
            of_position=True,
        )
