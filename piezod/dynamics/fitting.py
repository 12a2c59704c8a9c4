"""Fits the model of a response to measured ones: gain, delay, and the number of resonances.

The measured response about one voltage is gain · (if/f₀)^-a · exp(-iφ) · G(f). The first factor is
the slope of small loops, which depends on the voltage. The second is creep: the displacement falls
with the logarithm of the frequency. The third is the phase of small loops, equal at all
frequencies. G has a static gain of one, and a delay whose phase grows with the frequency.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from piezod.dynamics.fit_problem import BETTER, FitProblem
from piezod.dynamics.fit_solution import Solution
from piezod.dynamics.hold import held
from piezod.dynamics.measured import MeasuredResponse
from piezod.dynamics.model import Resonance, ResponseModel
from piezod.errors import DataError

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

MOST_RESONANCES: Final = 3
CLEAR: Final = 0.2
"""Lines with a larger relative uncertainty are not used."""
FEWEST_LINES: Final = 12
"""Smallest number of lines of a fit."""
SMALLEST_SPAN: Final = 4.0
"""Smallest ratio of the highest to the lowest frequency of a fit."""


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A fitted model."""

    model: ResponseModel  #: The model.
    delay_uncertainty_s: float  #: Standard uncertainty of its delay, in s.
    #: Standard uncertainties of each resonance: frequency in Hz, damping, share.
    uncertainties: tuple[tuple[float, float, float], ...]
    #: Gain of each response at the lowest line, and its standard uncertainty.
    gains: tuple[tuple[float, float], ...]
    phase_rad: float  #: Phase lag of small loops, in rad.
    creep: float  #: Exponent of creep: relative fall of the gain per e-fold of the frequency.
    used: tuple[MeasuredResponse, ...]  #: The lines that were used, of each response.
    #: Bayesian information criterion by number of resonances; lower is better. Numbers whose modes
    #: the lines do not determine are left out.
    criterion: dict[int, float]
    rms: float  #: Rms distance of measured and fitted response, in standard uncertainties.
    rate_hz: float | None = None  #: Rate at which the drive was held; None if it was continuous.
    #: Whether the lines show a mode above half of the rate, folded below it.
    is_folded: bool = False

    @property
    def low_hz(self) -> float:
        """Lowest used frequency, in Hz."""
        return min(float(each.frequency_hz[0]) for each in self.used)

    @property
    def high_hz(self) -> float:
        """Highest used frequency, in Hz."""
        return max(float(each.frequency_hz[-1]) for each in self.used)

    def slow_part(self, index: int, frequency_hz: FloatArray) -> ComplexArray:
        """Return gain, creep and phase of a response, shape (n,): all of it but the model.

        Args:
            index: Number of the response.
            frequency_hz: (n,) frequencies, in Hz.
        """
        gain, _ = self.gains[index]
        creep = (1j * frequency_hz / self.low_hz) ** -self.creep
        return np.asarray(gain * np.exp(-1j * self.phase_rad) * creep)

    def held(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the model as the lines show it: with the hold, without its delay, shape (n,)."""
        if self.rate_hz is None:
            return self.model.at(frequency_hz)
        return held(self.model, frequency_hz, self.rate_hz)

    def fitted(self, index: int, frequency_hz: FloatArray) -> ComplexArray:
        """Return the fit of a response, shape (n,).

        Args:
            index: Number of the response.
            frequency_hz: (n,) frequencies, in Hz.
        """
        return self.slow_part(index, frequency_hz) * self.held(frequency_hz)


def fit_response(
    responses: Sequence[MeasuredResponse], rate_hz: float | None = None
) -> ResponseFit:
    """Fit one model to the responses about several voltages.

    Args:
        responses: The responses; their dynamics are the same, their gains are not.
        rate_hz: Rate at which the drive was held; None if it was continuous. The delay of the hold,
            half a period, is not part of the responses.

    Raises:
        DataError: If too few lines are clear of the noise.
    """
    used = tuple(_clear_lines(each) for each in responses)
    problem = FitProblem(used, rate_hz)
    solved, folded, found = dict[int, Solution](), list[float](), None
    for count in range(MOST_RESONANCES + 1):
        found = problem.best(count, found)
        if found is not None and problem.admits(found):
            solved[count] = found
            if problem.is_exhausted(found):
                break
        elif found is not None and problem.is_folded(found):
            folded.append(problem.criterion(found))
    criterion = {count: problem.criterion(each) for count, each in solved.items()}
    chosen = 0
    for count, value in criterion.items():
        if value < criterion[chosen] - BETTER:
            chosen = count
    # Images of a mode look like other modes. Where they explain the lines better, none is claimed.
    is_folded = min(folded, default=np.inf) < criterion[chosen] - BETTER
    fit = _result(problem, used, solved[0 if is_folded else chosen], criterion)
    return replace(fit, rate_hz=rate_hz, is_folded=is_folded)


def _clear_lines(response: MeasuredResponse) -> MeasuredResponse:
    clear = response.where(response.relative_uncertainty <= CLEAR)
    count, frequency_hz = clear.frequency_hz.size, clear.frequency_hz
    if count >= FEWEST_LINES and frequency_hz[-1] >= SMALLEST_SPAN * frequency_hz[0]:
        return clear
    span = f", from {frequency_hz[0]:.4g} to {frequency_hz[-1]:.4g} Hz" if count else ""
    raise DataError(
        f"no model: {count} of {response.frequency_hz.size} lines are clear of the noise{span}; "
        f"needed are {FEWEST_LINES} lines with an uncertainty below {100.0 * CLEAR:g} %, over a "
        f"factor of {SMALLEST_SPAN:g} in frequency"
    )


def _result(
    problem: FitProblem,
    used: tuple[MeasuredResponse, ...],
    solution: Solution,
    criterion: dict[int, float],
) -> ResponseFit:
    parts, uncertain = solution.parts, problem.uncertainties(solution)
    values = np.stack(parts[1:], axis=1)
    order = np.argsort(parts.frequencies_hz)
    gains = problem.signs * np.exp(parts.fixed[: problem.gains])
    return ResponseFit(
        model=ResponseModel(
            1e-3 * float(parts.fixed[-1]),
            tuple(Resonance(*row) for row in values[order].tolist()),
        ),
        delay_uncertainty_s=1e-3 * float(uncertain.fixed[-1]),
        uncertainties=tuple(map(tuple, np.stack(uncertain[1:], axis=1)[order].tolist())),
        gains=tuple(
            (float(gain), float(abs(gain) * part))
            for gain, part in zip(gains, uncertain.fixed, strict=False)
        ),
        phase_rad=float(parts.fixed[-3]),
        creep=float(parts.fixed[-2]),
        used=used,
        criterion=criterion,
        rms=float(np.sqrt(2.0 * solution.cost / problem.residuals)),
    )
