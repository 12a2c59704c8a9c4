"""The loop of the trim in discrete time, as a frequency response.

The trim integrates the error, adds a share of the error itself, and has a notch at each mode. Its
output is in force one cycle after its sample. A zero-order hold, the modes, and a delay of any
length between drive and sensor follow. The part of the delay that is no whole period splits the
held drive in two (modified z-transform). For a gain of 1/s, a period T and a proportional gain p:

    L(z) = (T/(z - 1) + p/z) · N(z) · z^-n · Σ_k share_k c (z I - A_k)^-1 (b_k0 + b_k1 / z),

with delay = n T + rest and the notches N. The paper has no trim. Source of the modified
z-transform: K. J. Åström and B. Wittenmark, "Computer-Controlled Systems", chapter 2.
"""

from functools import lru_cache
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from piezod.dynamics.model import ComplexArray, FloatArray, Resonance, ResponseModel
from piezod.dynamics.notch import notch


class TrimLaw(NamedTuple):
    """The gains of the trim, and its notches."""

    gain_per_s: float  #: Gain of the integral, in 1/s, positive.
    proportional: float = 0.0  #: Share of the error that is added to the integral, at least 0.
    notches: tuple[Resonance, ...] = ()  #: Modes at which the trim does not act.


class Sampled(NamedTuple):
    """A response in samples."""

    #: (n,) points on the upper half of the unit circle, from low frequencies to half the rate.
    z: ComplexArray
    response: ComplexArray  #: (n,) the response there.


def loop_response(law: TrimLaw, period_s: float, stage: Sampled) -> ComplexArray:
    """Return L, for a gain of 1/s, shape (n,).

    Args:
        law: The trim; the ratio of its gains counts.
        period_s: Period of the loop, in s.
        stage: The stage, from `sampled_stage`.
    """
    control = period_s / (stage.z - 1.0)
    if law.proportional:  # without it the response stays the same to the bit
        control = control + law.proportional / law.gain_per_s / stage.z
    for mode in law.notches:
        control = control * notch(mode, period_s).at(stage.z)
    return np.asarray(control * stage.response)


def sampled_stage(period_s: float, stage: ResponseModel) -> Sampled:
    """Return the response of a stage to a drive that is held, at the samples.

    Args:
        period_s: Period of the loop, in s.
        stage: From a voltage at the output to the sample, without the hold.
    """
    periods = stage.delay_s / period_s
    if not stage.resonances:
        whole = ceil(periods - 1e-9)  # a change between two samples shows at the second
        z = _points(whole)
        return Sampled(z, np.asarray(z**-whole))
    whole = floor(periods + 1e-9)
    rest_s = max(stage.delay_s - whole * period_s, 0.0)
    z = _points(whole, tuple(_pole(mode, period_s) for mode in stage.resonances))
    held = np.zeros_like(z)
    for mode in stage.resonances:
        held += mode.share * _held_mode(z, rest_s, period_s, mode)
    return Sampled(z, np.asarray(z**-whole * held))


def _pole(mode: Resonance, period_s: float) -> complex:
    """Return the pole of a mode, in angles per period."""
    angle = 2.0 * np.pi * mode.frequency_hz * period_s
    return angle * complex(-mode.damping, (1.0 - mode.damping**2) ** 0.5)


@lru_cache(maxsize=4)  # stages that differ in a part of a period have the same points
def _points(whole: int, poles: tuple[complex, ...] = ()) -> ComplexArray:
    """Return points z on the unit circle, dense where the response turns fast.

    The delay turns the response `whole` times. A mode turns it close to its frequency, within its
    damping; sampling folds that frequency into 0 to π.
    """
    parts = [np.geomspace(1e-8, np.pi, 4000), np.linspace(0.001, np.pi, 10_000 + 40 * whole)]
    for pole in poles:
        folded = abs((pole.imag + np.pi) % (2.0 * np.pi) - np.pi)
        aside = np.geomspace(-0.01 * pole.real, 4.0, 1000)
        parts += [folded - aside, np.array([folded]), folded + aside]
    angles = np.unique(np.concatenate(parts))
    z = np.exp(1j * angles[(angles > 0.0) & (angles <= np.pi)])
    z.flags.writeable = False
    return np.asarray(z)


def _held_mode(z: ComplexArray, rest_s: float, period_s: float, mode: Resonance) -> ComplexArray:
    """Return the mode behind a hold and a delay of less than a period, at the samples."""
    settled = np.array([1.0, 0.0])  # final state at a drive of 1; the difference decays freely
    whole, late = (free_motion(mode, t_s) for t_s in (period_s, period_s - rest_s))
    # A drive acts for the time left in its own period (new), and for the rest in the next one
    # (old).
    new = settled - late @ settled
    old = late @ settled - whole @ settled
    # The first row of (z I - A)^-1 is (z - A_11, A_01) over the determinant.
    (a_00, a_01), (a_10, a_11) = whole.tolist()
    once, same = new[0], old[0] - a_11 * new[0] + a_01 * new[1]
    before = a_01 * old[1] - a_11 * old[0]
    numerator = once * z + same + before * z.conj()  # on the unit circle it is 1/z
    return np.asarray(numerator / ((z - a_00) * (z - a_11) - a_01 * a_10))


def free_motion(mode: Resonance, t_s: float) -> FloatArray:
    """Return the transition matrix of a free mode, shape (2, 2).

    Returns:
        Displacement and speed (per radian) after that time, from those before it.
    """
    angle = 2.0 * np.pi * mode.frequency_hz * t_s
    damped_angle = angle * (1.0 - mode.damping**2) ** 0.5
    sine = angle * np.sinc(damped_angle / np.pi)
    system = np.array([[mode.damping, 1.0], [-1.0, -mode.damping]])
    decay = np.exp(-mode.damping * angle)
    return np.asarray(decay * (np.cos(damped_angle) * np.eye(2) + sine * system))
