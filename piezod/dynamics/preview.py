"""The preview filter: a command that is known ahead, before a stage with modes.

With the modes M(f) and the hold of a period T the stage follows a command by M(f) sinc(f T). The
filter H(f) = Σ h_j exp(2πi f j s T), j = -n..n, is its inverse as far as the stage can follow: from
zero to the first frequency at which the inverse amplifies too much. It needs future values, because
modes side by side may have no causal inverse. Around zero H equals the inverse in value, slope and
curvature, by three linear constraints; above, in least squares of H M sinc - 1, in which slow parts
of the command count most. Beyond the band H M is small, so that a corner does not ring a mode. Taps
that are several periods apart reach as far as the slowest mode needs. The paper has no dynamics.
"""

from typing import Final, NamedTuple

import numpy as np

from piezod.dynamics.model import ComplexArray, FloatArray, ResponseModel

SIDE_TAPS: Final = 8
"""n: taps on each side of the instant."""
LARGEST_GAIN: Final = 1.5
"""The band ends where the inverse amplifies more than this."""
BAND_PER_RATE: Final = 0.25
"""The band ends at this part of the rate at the latest."""
SAMPLING: Final = 3.0
"""Least rate of the taps over the end of the band."""
OUTSIDE_WEIGHTS: Final = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Weights of H M beyond the band, where 1 is the least weight inside. The smallest one counts with
which H is bounded."""
LARGEST_OUTSIDE: Final = 2.0
"""Largest |H|, at any frequency."""
SLOWEST: Final = 0.02
"""Frequencies below this part of the band count alike."""
_GRID, _AROUND_MODE = 400, np.linspace(-3.0, 3.0, 41)


class PreviewFilter(NamedTuple):
    """A filter without delay, and with a static gain of one.

    Attributes:
        taps: (2n + 1,) weights of the command, from the earliest value to the latest one.
        spacing: Periods from tap to tap, s.
        band_hz: End of its band, in Hz.
    """

    taps: FloatArray
    spacing: int
    band_hz: float

    @property
    def ahead(self) -> int:
        """Number of periods that the filter looks ahead, and back."""
        return self.taps.size // 2 * self.spacing

    def at(self, frequency_hz: FloatArray, period_s: float) -> ComplexArray:
        """Return its response at frequencies in Hz, shape (n,), for samples of a period in s."""
        return np.asarray(
            _waves(frequency_hz, self.taps.size // 2, self.spacing * period_s) @ self.taps
        )


def preview_filter(
    modes: ResponseModel, period_s: float, highest_hz: float = np.inf
) -> PreviewFilter:
    """Return the preview filter of a stage.

    Args:
        modes: The stage; its delay does not count, because the command is read ahead by it.
        period_s: Period of the loop, in s.
        highest_hz: Highest frequency at which the response is known, in Hz.
    """
    modes = ResponseModel(0.0, modes.resonances)
    band_hz = min(_followed_hz(modes), BAND_PER_RATE / period_s, highest_hz)
    spacing = max(1, int(1.0 / (SAMPLING * band_hz * period_s)))
    step_s = spacing * period_s
    frequency_hz = _grid(modes, 0.5 / step_s)
    stage = modes.at(frequency_hz) * np.sinc(frequency_hz * period_s)
    size, inside = np.abs(stage), frequency_hz <= band_hz
    slow_first = band_hz / np.maximum(frequency_hz, SLOWEST * band_hz)
    spread = np.sqrt(np.gradient(frequency_hz) / band_hz)
    waves = _waves(frequency_hz, SIDE_TAPS, step_s)
    constraints = _at_zero(modes, period_s, step_s, band_hz)
    for outside in OUTSIDE_WEIGHTS:
        weight = np.where(inside, size * slow_first, outside * np.maximum(size, 1.0)) * spread
        taps = _fit(weight[:, np.newaxis] * waves, weight * inside / stage, *constraints)
        if np.abs(waves @ taps).max() <= LARGEST_OUTSIDE:
            break
    return PreviewFilter(taps, spacing, band_hz)


def _followed_hz(modes: ResponseModel) -> float:
    """Return the first frequency at which the inverse amplifies too much, in Hz."""
    if not modes.resonances:
        return np.inf
    frequencies = [mode.frequency_hz for mode in modes.resonances]
    # Beyond twice the highest mode a stage follows less and less.
    grid = np.geomspace(0.01 * min(frequencies), 2.0 * max(frequencies), 4000)
    lost = LARGEST_GAIN * np.abs(modes.at(grid)) < 1.0
    return float(grid[np.argmax(lost)]) if np.any(lost) else float(grid[-1])


def _grid(modes: ResponseModel, end_hz: float) -> FloatArray:
    """Return frequencies from zero to an end, dense around the modes, in Hz."""
    parts = [np.linspace(0.0, end_hz, _GRID)]
    for mode in modes.resonances:
        parts.append(mode.frequency_hz * (1.0 + mode.damping * _AROUND_MODE))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= 0.0) & (grid <= end_hz)]


def _waves(frequency_hz: FloatArray, side: int, step_s: float) -> ComplexArray:
    """Return the response of each tap, shape (n, 2 side + 1)."""
    times_s = step_s * np.arange(-side, side + 1)
    return np.asarray(np.exp(2j * np.pi * np.outer(frequency_hz, times_s)))


def _at_zero(
    modes: ResponseModel, period_s: float, step_s: float, band_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Return rows and values of the three constraints: H as the inverse around zero."""
    # M sinc = 1 - i a f - b f² + …, so that 1/(M sinc) = 1 + i a f + (b - a²) f² + …
    a = sum(mode.share * 2.0 * mode.damping / mode.frequency_hz for mode in modes.resonances)
    b = sum(
        mode.share * (4.0 * mode.damping**2 - 1.0) / mode.frequency_hz**2
        for mode in modes.resonances
    )
    b += (np.pi * period_s) ** 2 / 6.0
    turns = 2.0 * np.pi * band_hz * step_s * np.arange(-SIDE_TAPS, SIDE_TAPS + 1)
    rows = np.stack([np.ones_like(turns), turns, -0.5 * turns**2])
    return rows, np.array([1.0, a * band_hz, (b - a**2) * band_hz**2])


def _fit(
    waves: ComplexArray, wanted: ComplexArray, rows: FloatArray, values: FloatArray
) -> FloatArray:
    """Return the taps with the least |waves @ taps - wanted| for which rows @ taps = values."""
    # Real taps: real and imaginary parts are equations of their own.
    matrix = np.concatenate([waves.real, waves.imag])
    right = np.concatenate([wanted.real, wanted.imag])
    # The solutions of the constraints are one of them, plus the null space of the rows.
    basis, triangle = np.linalg.qr(rows.T, mode="complete")
    fixed = basis[:, : values.size] @ np.linalg.solve(triangle[: values.size].T, values)
    free = basis[:, values.size :]
    solution, *_ = np.linalg.lstsq(matrix @ free, right - matrix @ fixed, rcond=None)
    return np.asarray(fixed + free @ solution)
