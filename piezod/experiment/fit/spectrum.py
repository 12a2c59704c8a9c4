"""The spectrum of a residual: a vibration at one frequency, and the floor of white noise."""

import numpy as np

from piezod.hysteresis.memory import FloatArray

BAND = 0.05
"""Half width of the band of a vibration, as a share of its frequency."""
ABOVE_NEIGHBOURS = 5.0
"""The power of a vibration is at least this many times that of the bands beside it."""
DRIVE_SHARE, HARMONICS = 0.99, 10
"""Below the highest frequency of the drive (this share of its power lies below) times this number,
a line may be a harmonic of the drive: an error of the loops, no vibration."""
_NEIGHBOURS = (-3, -2, 2, 3)  # in steps of one band
_FIRST_LINE = 15  # below it a band would not contain a whole line


def power_spectrum(values: FloatArray) -> FloatArray:
    """Return the mean square of values over time without their mean, per line of the spectrum.

    The result has the shape (n // 2 + 1,); its sum is the mean square.
    """
    centred = values - values.mean()
    # The window keeps slow and strong parts from leaking over the spectrum.
    power = np.abs(np.fft.rfft(centred * np.hanning(values.size))) ** 2
    total = float(np.sum(power))
    spectrum: FloatArray = power * (float(np.mean(centred**2)) / total) if total else power
    return spectrum


def vibration_of(
    residuals: FloatArray, drive: FloatArray, period_s: float
) -> tuple[float, float | None]:
    """Return the rms of a vibration and its frequency in Hz; 0 and None if there is none.

    Args:
        residuals: (n,) residuals over time.
        drive: (n,) drive, whose frequencies are no vibration.
        period_s: Sample period, in s.
    """
    power = power_spectrum(residuals)
    moved = np.cumsum(power_spectrum(drive))
    lowest = HARMONICS * (int(np.searchsorted(moved, DRIVE_SHARE * moved[-1])) + 1)
    # Three bands below the lowest one are neighbours only; the highest ones lack upper neighbours.
    ratio, most = (1.0 + BAND) / (1.0 - BAND), max(_NEIGHBOURS)
    first = lowest / ratio**most
    count = int(np.log(max((power.size - 1) / first, 1.0)) / np.log(ratio))
    if first < _FIRST_LINE or count <= most:
        return 0.0, None
    edges = np.rint(first * ratio ** np.arange(count + 1)).astype(np.int64)
    bands = np.add.reduceat(power[: edges[-1]], edges[:-1]) / np.diff(edges)
    inner = np.arange(most, bands.size)
    known = np.pad(bands, (0, most), constant_values=np.nan)
    beside = np.nanmean([known[inner + shift] for shift in _NEIGHBOURS], axis=0)
    found = inner[bands[inner] > ABOVE_NEIGHBOURS * beside]
    if not found.size:
        return 0.0, None
    best = int(found[np.argmax((bands * np.diff(edges))[found])])
    # The vibration may lie on an edge: its neighbours count, too.
    around = slice(int(edges[best - 1]), int(edges[min(best + 2, bands.size)]))
    strongest = around.start + int(np.argmax(power[around]))
    excess = float(np.sum(power[around])) - float(np.min(beside)) * (around.stop - around.start)
    return float(np.sqrt(max(excess, 0.0))), strongest / (residuals.size * period_s)


def noise_density_of(residuals: FloatArray) -> float:
    """Return the mean square of white noise with the density that residuals have at low frequency.

    It is that above the harmonics of a slow drive, and below the filter of a sensor: from a tenth
    to half of the highest frequency.

    Args:
        residuals: (n,) residuals over time.
    """
    power = power_spectrum(residuals)
    band = power[power.size // 10 : power.size // 2]
    # As in `noise_of`: the power of a line has an exponential distribution.
    return float(np.median(band)) / float(np.log(2.0)) * power.size if band.size else 0.0


def noise_of(residuals: FloatArray, vibration_hz: float | None, period_s: float) -> float:
    """Return the rms of the white noise, from the upper half of the spectrum.

    Args:
        residuals: (n,) residuals over time.
        vibration_hz: Frequency of a vibration, which does not count; None if there is none.
        period_s: Sample period, in s.
    """
    power = power_spectrum(residuals)
    lines = np.arange(power.size)
    high = lines > power.size // 2
    if vibration_hz is not None:
        line = vibration_hz * residuals.size * period_s
        high &= np.abs(lines - line) > 4.0 * BAND * line
    if not high.any():
        return 0.0
    # The power of a line of white noise has an exponential distribution: its mean is median / ln 2.
    floor = float(np.median(power[high])) / np.log(2.0)
    return float(np.sqrt(floor * power.size))
