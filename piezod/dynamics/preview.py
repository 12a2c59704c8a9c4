"""The preview filter: a command that is known ahead, before a stage with modes.

With the modes M(f) and the hold of a period T the stage follows a command by M(f) sinc(f T). The
filter H(f) = Σ h_j exp(2πi f j s T), j = -n..n, is its inverse as far as the stage can follow: from
zero to the first frequency at which the inverse amplifies too much. It needs future values, because
modes side by side may have no causal inverse. Its taps are those of least squares of H M sinc - 1,
in which slow parts of the command count most, with a static gain of exactly one. Beyond the band
H M is small, so that a corner does not ring a mode. Taps that are several periods apart reach as
far as the slowest mode needs. The paper has no dynamics.
"""

from typing import Final, NamedTuple

import numpy as np

from piezod.dynamics.model import ComplexArray, FloatArray, ResponseModel
from piezod.errors import ModelError

SIDE_TAPS: Final = 8
"""n: taps on each side of the instant."""
LARGEST_INVERSE: Final = 1.5
"""The band ends where the inverse amplifies more than this."""
BAND_PER_RATE: Final = 0.25
"""The band ends at this part of the rate at the latest."""
SAMPLING: Final = 3.0
"""Least rate of the taps over the end of the band."""
SLOWEST: Final = 0.05
"""Frequencies below this part of the band count alike; above, with the inverse of their square."""
OUTSIDE_WEIGHTS: Final = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Weights of H M beyond the band, over that at its end. They are tried one after the other."""
LARGEST_GAIN: Final = 2.0
"""Largest |H|, at any frequency."""
LARGEST_MISFIT: Final = 0.05
"""Largest |H M sinc - 1| up to half of the band."""
NARROWER: Final = 0.7
"""Ratio of the bands that are tried one after the other: taps cannot follow all modes."""
_NARROWEST: Final = 0.01
_GRID, _AROUND_MODE = 400, np.linspace(-3.0, 3.0, 41)


class PreviewFilter(NamedTuple):
    """A filter without delay, and with a static gain of one."""

    taps: (
        FloatArray  #: (2n + 1,) weights of the command, from the earliest value to the latest one.
    )
    spacing: int  #: Periods from tap to tap, s.
    band_hz: float  #: End of its band, in Hz.

    @property
    def ahead(self) -> int:
        """Number of periods that the filter looks ahead, and back."""
        return self.taps.size // 2 * self.spacing

    def at(self, frequency_hz: FloatArray, period_s: float) -> ComplexArray:
        """Return its response at frequencies in Hz, shape (n,), for samples of a period in s."""
        return np.asarray(_waves(frequency_hz, self.spacing * period_s) @ self.taps)


def preview_filter(modes: ResponseModel, period_s: float) -> PreviewFilter:
    """Return the preview filter of a stage.

    Args:
        modes: The stage; its delay does not count, because the command is read ahead by it.
        period_s: Period of the loop, in s.

    Raises:
        ModelError: If no taps follow the modes, for instance because they are close together, or
            because a slow one has a small share beside a fast one.
    """
    modes = ResponseModel(0.0, modes.resonances)
    followed_hz = min(_followed_hz(modes), BAND_PER_RATE / period_s)
    band_hz = followed_hz
    while band_hz > _NARROWEST * followed_hz:
        for outside in OUTSIDE_WEIGHTS:
            tried = _fitted(modes, period_s, band_hz, outside)
            if _is_good(tried, modes, period_s):
                return tried
        band_hz *= NARROWER
    raise ModelError(
        f"no filter of {2 * SIDE_TAPS + 1} taps inverts the {len(modes.resonances)} modes of the "
        "response; fit fewer resonances"
    )


def _followed_hz(modes: ResponseModel) -> float:
    """Return the first frequency at which the inverse amplifies too much, in Hz."""
    frequencies = [mode.frequency_hz for mode in modes.resonances]
    # Beyond twice the highest mode a stage follows less and less.
    grid = np.geomspace(0.01 * min(frequencies), 2.0 * max(frequencies), 4000)
    lost = LARGEST_INVERSE * np.abs(modes.at(grid)) < 1.0
    return float(grid[np.argmax(lost)]) if np.any(lost) else float(grid[-1])


def _fitted(modes: ResponseModel, period_s: float, band_hz: float, outside: float) -> PreviewFilter:
    """Return the filter of least squares for a band, in Hz, and a weight beyond it."""
    spacing = max(1, int(1.0 / (SAMPLING * band_hz * period_s)))
    frequency_hz = _grid(modes, 0.5 / (spacing * period_s))
    stage = _held(modes, frequency_hz, period_s)
    size, inside = np.abs(stage), frequency_hz <= band_hz
    slow_first = (band_hz / np.maximum(frequency_hz, SLOWEST * band_hz)) ** 2
    weight = np.where(inside, size * slow_first, outside * np.maximum(size, 1.0))
    weight *= np.sqrt(np.gradient(frequency_hz) / band_hz)
    waves = _waves(frequency_hz, spacing * period_s)
    # All taps but the one at the instant; that one makes the static gain one.
    sides = np.delete(waves, SIDE_TAPS, axis=1) - 1.0
    matrix = weight[:, np.newaxis] * sides
    right = weight * (inside / stage - 1.0)
    # Real taps: real and imaginary parts are equations of their own.
    taps, *_ = np.linalg.lstsq(
        np.concatenate([matrix.real, matrix.imag]),
        np.concatenate([right.real, right.imag]),
        rcond=None,
    )
    return PreviewFilter(np.insert(taps, SIDE_TAPS, 1.0 - taps.sum()), spacing, band_hz)


def _is_good(tried: PreviewFilter, modes: ResponseModel, period_s: float) -> bool:
    """Return whether a filter is bounded, and fits up to half of its band."""
    frequency_hz = _grid(modes, 0.5 / (tried.spacing * period_s))
    gain = tried.at(frequency_hz, period_s)
    misfit = np.abs(gain * _held(modes, frequency_hz, period_s) - 1.0)
    inside = frequency_hz <= 0.5 * tried.band_hz
    return bool(np.abs(gain).max() <= LARGEST_GAIN and misfit[inside].max() <= LARGEST_MISFIT)


def _held(modes: ResponseModel, frequency_hz: FloatArray, period_s: float) -> ComplexArray:
    """Return the response of the stage to a held command."""
    return np.asarray(modes.at(frequency_hz) * np.sinc(frequency_hz * period_s))


def _grid(modes: ResponseModel, end_hz: float) -> FloatArray:
    """Return frequencies from zero to an end, dense around the modes, in Hz."""
    parts = [np.linspace(0.0, end_hz, _GRID)]
    for mode in modes.resonances:
        parts.append(mode.frequency_hz * (1.0 + mode.damping * _AROUND_MODE))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= 0.0) & (grid <= end_hz)]


def _waves(frequency_hz: FloatArray, step_s: float) -> ComplexArray:
    """Return the response of each tap, shape (n, taps)."""
    times_s = step_s * np.arange(-SIDE_TAPS, SIDE_TAPS + 1)
    return np.asarray(np.exp(2j * np.pi * np.outer(frequency_hz, times_s)))
