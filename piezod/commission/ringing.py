"""Step "ringing": the first resonance, from the response to small steps.

A mode above half the rate appears at another, aliased frequency. Two rates give two aliases, and
only one frequency explains both.
"""

from itertools import product
from math import pi
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import minimize

from piezod.commission.session import Session
from piezod.commission.session_trace import SessionTrace, joined
from piezod.errors import LatenessError
from piezod.hysteresis.memory import FloatArray

STEPS: Final = 24
"""Number of steps; their mean has a fifth of the noise."""
RECORD_S: Final = 0.1
"""Evaluated part of a response, in s: longer than the ringing of usual stages."""
OTHER_RATE: Final = 0.83
"""The second rate, as a fraction of the first."""
FOLDS: Final = 3
"""Highest searched frequency, in multiples of the rate."""
SIGNIFICANT: Final = 12.0
"""F-ratio above which a line is a mode: variance explained per parameter over that of the noise."""
LOWEST_CYCLES: Final = 4
"""Smallest number of cycles in the record; a slower line is creep."""
TRANSIENT_S: Final = 1.5e-3
"""Excluded start of the record, in s: the step itself, through the sensor's filter."""
PARAMETERS: Final = 7
"""Parameters of the fit: three for the creep, four for the line."""
FREQUENCIES, DECAYS = 150, 8
"""Size of the search grid."""


class Ringing(NamedTuple):
    """Result of the step; all NaN if no resonance was found."""

    frequency_hz: float  #: Frequency of the first mode, in Hz.
    damping: float  #: Its damping ratio.
    searched_hz: float  #: Highest searched frequency, in Hz.

    @property
    def found(self) -> bool:
        """Whether a resonance was found."""
        return self.frequency_hz > 0


class _Line(NamedTuple):
    apparent_hz: float
    rate_hz: float
    resolution_hz: float
    decay_per_s: float


def find_ringing(session: Session, size_v: float) -> tuple[Ringing, SessionTrace]:
    """Step up and down at two rates and find the resonance in the responses.

    Args:
        session: The axis.
        size_v: Size of the steps from the present voltage, in V; negative for steps down.

    Raises:
        DeviceError: If a device reports a fault.
        LatenessError: If too many samples are late.
    """
    searched_hz = FOLDS * session.rate_hz
    traces: list[SessionTrace] = []
    lines = [
        _line(*_mean_response(session, size_v, rate_hz, traces))
        for rate_hz in (session.rate_hz, OTHER_RATE * session.rate_hz)
    ]
    first, second = lines
    if first is None or second is None:
        return Ringing(np.nan, np.nan, searched_hz), joined(traces)
    frequency_hz = _unfolded(first, second)
    damping = first.decay_per_s / (2 * pi * frequency_hz)
    return Ringing(frequency_hz, min(damping, 1.0), searched_hz), joined(traces)


def _mean_response(
    session: Session, size_v: float, rate_hz: float, traces: list[SessionTrace]
) -> tuple[FloatArray, float]:
    """Return the mean response to the steps, in µm; steps back count with reversed sign.

    Raises:
        LatenessError: If half of the responses are not even in time.
    """
    begin_v = session.drive_v
    n = round(RECORD_S * rate_hz)
    total, count, late = np.zeros(n), 0, 0
    for i in range(STEPS):
        target_v = begin_v + size_v if i % 2 == 0 else begin_v
        trace = session.drive(lambda _t_s, v=target_v: v, RECORD_S * 1.05, rate_hz)  # type: ignore[misc] # a default that binds the loop's value
        traces.append(trace)
        if trace.has_gap(rate_hz, n + 1):
            late += 1
            continue
        response = trace.position_um[1 : n + 1]  # the first sample is from before the step
        if response.size == n and np.all(np.isfinite(response)):
            total += response if i % 2 == 0 else -response
            count += 1
    if 2 * late >= STEPS:
        raise LatenessError(f"{late} of {STEPS} responses to steps lack samples")
    return total / max(count, 1), rate_hz


def _line(response: FloatArray, rate_hz: float) -> _Line | None:
    """Return the decaying line that explains most of a response; None if none is significant."""
    t_s = np.arange(response.size) / rate_hz
    late = t_s > TRANSIENT_S
    freedom = int(np.count_nonzero(late)) - PARAMETERS
    if freedom < 1:
        return None
    t_s, response = t_s[late] - t_s[late][0], response[late]
    without = _residual(_creep_basis(t_s), response)
    # A grid first: the sum of squares has many local minima over the frequency.
    apparent_hz, decay_per_s = min(
        product(
            np.linspace(LOWEST_CYCLES / t_s[-1], rate_hz / 2, FREQUENCIES),
            np.geomspace(1.0 / t_s[-1], 0.3 * rate_hz, DECAYS),
        ),
        key=lambda line: _residual(_ring_basis(t_s, *line), response),
    )
    rest = _residual(_ring_basis(t_s, apparent_hz, decay_per_s), response)
    # Written with `not >`: without any complete record both sides are 0, and nothing is found.
    if not (without - rest) / 4 > SIGNIFICANT * rest / freedom:
        return None
    found = minimize(
        lambda line: _residual(_ring_basis(t_s, *line), response),
        (apparent_hz, decay_per_s),
        method="Nelder-Mead",
    )
    return _Line(float(found.x[0]), rate_hz, 1.0 / t_s[-1], float(abs(found.x[1])))


def _creep_basis(t_s: FloatArray) -> FloatArray:
    """Return the basis functions of the creep after a step, shape (n, 3)."""
    # Creep is logarithmic in time; a few samples are added, because the log of 0 is infinite.
    log = np.log(t_s + 5 * t_s[1])
    return np.stack([np.ones_like(t_s), log, log**2], axis=1)


def _ring_basis(t_s: FloatArray, hz: float, decay_per_s: float) -> FloatArray:
    """Return the basis functions of creep and a decaying oscillation, shape (n, 5)."""
    angle, envelope = 2 * pi * hz * t_s, np.exp(-abs(decay_per_s) * t_s)
    wave = np.stack([envelope * np.cos(angle), envelope * np.sin(angle)], axis=1)
    return np.concatenate([_creep_basis(t_s), wave], axis=1)


def _residual(basis: FloatArray, response: FloatArray) -> float:
    """Return the sum of squares that a basis does not explain."""
    # With an orthonormal basis the explained sum of squares needs no solution of the fit.
    orthogonal, _ = np.linalg.qr(basis)
    return float(np.sum(response**2) - np.sum((orthogonal.T @ response) ** 2))


def _unfolded(first: _Line, second: _Line) -> float:
    """Return the frequency that explains both aliases, in Hz; the lowest if there are several."""
    tolerance_hz = 0.5 * (first.resolution_hz + second.resolution_hz)
    pairs = sorted((abs(a - b), a) for a in _candidates(first) for b in _candidates(second))
    close = [hz for off_hz, hz in pairs if off_hz < tolerance_hz]
    return min(close) if close else pairs[0][1]


def _candidates(line: _Line) -> list[float]:
    # Sampling folds f and k · rate ± f onto the same apparent frequency.
    folded = [line.apparent_hz]
    for k in range(1, FOLDS + 1):
        folded += [k * line.rate_hz - line.apparent_hz, k * line.rate_hz + line.apparent_hz]
    return [hz for hz in folded if 0 < hz <= FOLDS * line.rate_hz]
