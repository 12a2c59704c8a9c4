"""Measured frequency responses: from whole periods of a multisine, or from any record."""

from dataclasses import dataclass, fields
from typing import Final, Self

import numpy as np
import numpy.typing as npt

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

DISTORTION: Final = 1e-3
"""Smallest relative uncertainty of a line: the scatter of a few periods may be small by chance, and
the curvature of small loops does not scatter."""
SEGMENTS: Final = 9
"""Smallest number of segments of a record, without overlap; with overlap there are 17."""
SEGMENT_S: Final = 4.0
"""Longest segment, in s: lines then are 1 Hz apart."""
SEGMENT: Final = 256
"""A slow record has longer segments, of this many samples."""
MOST_LINES: Final = 400
"""Numbers of the lines that are kept, in geometric progression."""
_BAND: Final = 4
"""Frequencies of a segment that are one line: neighbours correlate."""
_HANN_POWER: Final = 3.0 / 8.0
"""Mean square of a Hann window."""
_HANN_OVERLAP: Final = 1.0 / 18.0
"""Loss of averages by the correlation of segments that overlap by half, under a Hann window."""


@dataclass(frozen=True, eq=False)
class MeasuredResponse:
    """A response at single frequencies."""

    frequency_hz: FloatArray  #: (n,) frequencies, in Hz, increasing.
    response: ComplexArray  #: (n,) output over input.
    #: (n,) variance of the response: mean square of the distance in the complex plane.
    variance: FloatArray
    coherence: FloatArray  #: (n,) coherence of input and output, 0 to 1.

    @property
    def relative_uncertainty(self) -> FloatArray:
        """Standard uncertainty over magnitude, (n,)."""
        return np.asarray(np.sqrt(self.variance) / np.maximum(np.abs(self.response), 1e-300))

    def where(self, lines: npt.NDArray[np.bool_] | IntArray) -> Self:
        """Return some of the lines."""
        return type(self)(*(getattr(self, each.name)[lines] for each in fields(self)))


def from_periods(
    drive: FloatArray, position: FloatArray, harmonics: IntArray, period_s: float
) -> MeasuredResponse:
    """Return the response at the lines of a multisine; whole periods have no leakage.

    Args:
        drive: (periods, samples) input, at least two periods.
        position: (periods, samples) output; its drift from period to period is removed.
        harmonics: (n,) numbers of the lines.
        period_s: Period, in s.
    """
    n = position.shape[1]
    # The same signal in each period: a change of the mean is drift, and nothing else.
    drift = np.gradient(position.mean(axis=1))
    inside = (np.arange(n) - 0.5 * (n - 1)) / n
    straight = position - drift[:, None] * inside
    given, found = (np.fft.rfft(each, axis=1)[:, harmonics] for each in (drive, straight))
    power = np.sum(np.abs(given) ** 2, axis=0)
    cross = np.sum(found * given.conj(), axis=0)
    response = cross / power
    rest = np.sum(np.abs(found - response * given) ** 2, axis=0) / (drive.shape[0] - 1)
    output = np.maximum(np.sum(np.abs(found) ** 2, axis=0), 1e-300)
    return MeasuredResponse(
        harmonics / period_s,
        response,
        rest / power + (DISTORTION * np.abs(response)) ** 2,
        np.clip(np.abs(cross) ** 2 / (power * output), 0.0, 1.0),
    )


def from_record(drive: FloatArray, position: FloatArray, rate_hz: float) -> MeasuredResponse:
    """Return the response of any record, by averages over segments (Welch, H1).

    Args:
        drive: (n,) input.
        position: (n,) output.
        rate_hz: Samples per second.
    """
    length = _segment(drive.size // SEGMENTS, rate_hz)
    frequency_hz = np.fft.rfftfreq(length, 1.0 / rate_hz)
    one, other = _spectra(drive, length), _spectra(position, length)
    cross = _density(one, other, length, rate_hz)
    given, found = (_density(each, each, length, rate_hz).real for each in (one, other))
    edges = np.arange(_BAND // 2, frequency_hz.size - _BAND, _BAND)
    weighted = np.add.reduceat(given * frequency_hz, edges)
    cross, given, found = (np.add.reduceat(each, edges) for each in (cross, given, found))
    given, found = np.maximum(given, 1e-300), np.maximum(found, 1e-300)
    response = np.asarray(cross / given, np.complex128)
    coherence = np.clip(np.abs(cross) ** 2 / (given * found), 1e-12, 1.0)
    averages = max(2 * drive.size // length - 1, 1) / (1.0 + _HANN_OVERLAP)
    scatter = (1.0 - coherence) / (coherence * averages)
    variance = np.abs(response) ** 2 * (scatter + DISTORTION**2)
    # The lines of a periodic drive are not in the middle of their bands.
    measured = MeasuredResponse(weighted / given, response, variance, coherence)
    kept = np.geomspace(1.0, edges.size, MOST_LINES).astype(np.int64) - 1
    return measured.where(np.unique(kept))


def _segment(longest: int, rate_hz: float) -> int:
    """Return the samples of a segment."""
    return max(8, min(longest, max(SEGMENT, round(SEGMENT_S * rate_hz))))


def _spectra(values: FloatArray, length: int) -> ComplexArray:
    """Return the spectra of segments that overlap by half, shape (segments, lines).

    Each segment is taken without its straight line, under a Hann window.
    """
    segments = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
    line = np.linspace(-1.0, 1.0, length)
    slopes = segments @ line / (line @ line)
    rest = segments - segments.mean(axis=1, keepdims=True) - slopes[:, None] * line
    window = np.hanning(length + 1)[:-1]
    return np.asarray(np.fft.rfft(window * rest, axis=1), np.complex128)


def _density(one: ComplexArray, other: ComplexArray, length: int, rate_hz: float) -> ComplexArray:
    """Return the one-sided cross density of two signals from their `_spectra`, shape (lines,)."""
    density: ComplexArray = np.mean(one.conj() * other, axis=0) / (_HANN_POWER * length * rate_hz)
    # All frequencies but 0 and half of the rate stand for a negative one, too.
    density[1 : (length + 1) // 2] *= 2.0
    return density


def noise_density(values: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies in Hz, and the amplitude density of values, in their unit per √Hz.

    Args:
        values: (n,) samples, at least 8.
        rate_hz: Samples per second.
    """
    length = _segment(values.size // 4, rate_hz)
    spectra = _spectra(values, length)
    power = _density(spectra, spectra, length, rate_hz).real
    frequency_hz = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), np.float64)
    return frequency_hz[1:], np.asarray(np.sqrt(power[1:]), np.float64)
