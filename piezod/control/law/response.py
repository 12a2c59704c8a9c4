"""The loop of the trim in discrete time, as a frequency response.

The loop has an integrator, whose output is in force one cycle after its sample, a zero-order hold,
the first mode, and a delay of any length between drive and sensor. The part of the delay that is no
whole period splits the held drive in two (modified z-transform). For a gain of 1/s and period T:

    L(z) = T/(z - 1) · z^-n · c (z I - A)^-1 (b_0 + b_1 / z),     delay = n T + rest.

The paper has no trim. Source of the modified z-transform: K. J. Åström and B. Wittenmark,
"Computer-Controlled Systems", chapter 2.
"""

from math import ceil, floor

import numpy as np
import numpy.typing as npt

from piezod.control.law.first_mode import FirstMode

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]


def loop_response(
    period_s: float, delay_s: float, mode_hz: float | None, mode_damping: float | None
) -> ComplexArray:
    """Return L from low frequencies to half the sample rate, shape (n,).

    Args:
        period_s: Period of the loop, in s.
        delay_s: Delay from drive to sensor, in s, not negative.
        mode_hz: Undamped frequency of the first mode, in Hz; None for a stage that follows at once.
        mode_damping: Damping ratio of the mode, in (0, 1]; None for such a stage.
    """
    periods = delay_s / period_s
    if mode_hz is None or mode_damping is None:
        whole = ceil(periods - 1e-9)  # a change between two samples shows at the second
        z = np.exp(1j * _angles(whole))
        return np.asarray(period_s / (z - 1.0) * z**-whole)
    whole = floor(periods + 1e-9)
    rest_s = max(delay_s - whole * period_s, 0.0)
    # The pole of the mode, in angles per period.
    pole = 2.0 * np.pi * mode_hz * period_s * complex(-mode_damping, (1.0 - mode_damping**2) ** 0.5)
    z = np.exp(1j * _angles(whole, pole))
    mode = _held_mode(z, rest_s, period_s, mode_hz, mode_damping)
    return np.asarray(period_s / (z - 1.0) * z**-whole * mode)


def _angles(whole: int, pole: complex | None = None) -> FloatArray:
    """Return frequencies as angles of z, dense where the response turns fast.

    The delay turns the response `whole` times. The mode turns it close to its frequency, within its
    damping; sampling folds that frequency into 0 to π.
    """
    parts = [np.geomspace(1e-8, np.pi, 4000), np.linspace(0.001, np.pi, 10_000 + 40 * whole)]
    if pole is not None:
        folded = abs((pole.imag + np.pi) % (2.0 * np.pi) - np.pi)
        aside = np.geomspace(-0.01 * pole.real, 4.0, 1000)
        parts += [folded - aside, np.array([folded]), folded + aside]
    angles = np.unique(np.concatenate(parts))
    return angles[(angles > 0.0) & (angles <= np.pi)]


def _held_mode(
    z: ComplexArray, rest_s: float, period_s: float, mode_hz: float, mode_damping: float
) -> ComplexArray:
    """Return the mode behind a hold and a delay of less than a period, at the samples."""
    settled = np.array([1.0, 0.0])  # final state at a drive of 1; the difference decays freely
    mode = FirstMode(mode_hz, mode_damping)
    whole, late = (mode.free_motion(t_s) for t_s in (period_s, period_s - rest_s))
    # A drive acts for the time left in its own period (new), and for the rest in the next one
    # (old).
    new = settled - late @ settled
    old = late @ settled - whole @ settled
    entry = new + old / z[:, np.newaxis]
    # The first row of (z I - A)^-1, for a matrix of two rows.
    determinant = (z - whole[0, 0]) * (z - whole[1, 1]) - whole[0, 1] * whole[1, 0]
    first = np.stack([z - whole[1, 1], np.full_like(z, whole[0, 1])], axis=1)
    return np.asarray(np.sum(first * entry, axis=1) / determinant)
